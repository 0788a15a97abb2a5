"""Base of emulated instruments: started, reached at a URL, closed."""

from typing import Protocol, Self


class Server(Protocol):
    """A link that answers: sockets or a pseudo-terminal."""

    @property
    def url(self) -> str:
        """URL at which it is reached, once started."""
        ...

    def start(self) -> None:
        """Open the port and serve."""
        ...

    def close(self) -> None:
        """Stop serving; harmless when done twice."""
        ...


class Served:
    """An emulated instrument on a server; a context manager that starts and closes it."""

    _server: Server

    @property
    def url(self) -> str:
        """URL for the station file; known once started."""
        return self._server.url

    def start(self) -> None:
        """Open the port and serve."""
        self._server.start()

    def close(self) -> None:
        """Stop serving; harmless when done twice."""
        self._server.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
