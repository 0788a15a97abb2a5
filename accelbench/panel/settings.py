"""Settings of the operator's page, as its command line gives them."""

from dataclasses import dataclass
from pathlib import Path

from errormodel.errors import InputError

LOOPBACK = ("127.0.0.1", "::1", "localhost")


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelSettings:
    """Settings of the operator's page.

    Attributes
    ----------
    store : str
        URL or file name of the store.
    stations, sequences : Path
        Folders that the browser may choose files from; what it makes goes into `sequences`.
    host : str
        Address to listen on.
    port : int
    users : Path or None
        File of users. None: everybody at this machine is the administrator `name`.
    name : str
        Name entered for actions where there are no users.
    notify : Path or None
        File that says who is told of alarms.
    """

    store: str
    stations: Path
    sequences: Path
    host: str = "127.0.0.1"
    port: int = 8300
    users: Path | None = None
    name: str
    notify: Path | None = None

    def __post_init__(self) -> None:
        if not self.is_loopback and self.users is None:
            raise InputError(
                f"--host {self.host}",
                "",
                "other machines can reach this address; expected --users FILE, which "
                "`accelbench panel-user` makes",
            )
        for option, folder in (("--stations", self.stations), ("--sequences", self.sequences)):
            if not folder.is_dir():
                raise InputError(folder, option, "no such folder")

    @property
    def is_loopback(self) -> bool:
        """True if only this machine can reach the address."""
        return self.host in LOOPBACK
