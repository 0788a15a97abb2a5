"""Base of the instruments on a serial line."""

from collections.abc import Callable
from typing import TypeVar

from drivers.devices import LinkCounters
from drivers.errors import ProtocolError
from drivers.links.serial_link import SerialLink

T = TypeVar("T")


class SerialInstrument:
    """An instrument that answers lines of text and keeps its errors in a queue.

    Parameters
    ----------
    link : SerialLink
        The way to it; it bears the instrument's name. It is opened.

    Raises
    ------
    LinkError
        If the port cannot be opened.
    """

    def __init__(self, link: SerialLink) -> None:
        self._link = link
        self._name = link.name
        link.open()

    @property
    def name(self) -> str:
        """The instrument's name in the station file."""
        return self._name

    @property
    def counters(self) -> LinkCounters:
        """Exchanges, retries and faults so far."""
        return self._link.counters

    def close(self) -> None:
        """Close the port; the instrument goes on with what it was doing."""
        self._link.close()

    def _parsed(self, reply: str, parse: Callable[[str], T]) -> T:
        """Parse a reply; what is wrong with it is told with the instrument's name."""
        try:
            return parse(reply)
        except ProtocolError as err:
            raise ProtocolError(f"{self._name}: {err}") from None

    def _read_errors(
        self, question: str, parse: Callable[[str], tuple[int, str]], depth: int
    ) -> list[tuple[int, str]]:
        """Empty the error queue, which holds `depth` at most; return codes and texts."""
        errors: list[tuple[int, str]] = []
        for _ in range(depth + 1):
            self._link.send(question)
            error = self._parsed(self._link.receive(), parse)
            if error[0] == 0:
                break
            errors.append(error)
        return errors
