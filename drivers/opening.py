"""From a station file's configuration to devices that can be used."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from drivers.chambers.open import open_chamber
from drivers.clock import Clock
from drivers.devices import Chamber, Device, Digitiser, IndexingHead
from drivers.digitisers.keysight_34970a import ScanningMultimeter
from drivers.errors import LinkError
from drivers.heads.newport_esp301 import MotionHead
from drivers.station import StationConfig

log = logging.getLogger(__name__)

Opened = TypeVar("Opened", bound=Device)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Station:
    """The three instruments of a station; a context manager that closes them."""

    chamber: Chamber
    digitiser: Digitiser
    head: IndexingHead
    config: StationConfig

    @property
    def devices(self) -> Mapping[str, Device]:
        """The instruments by their names in the station file."""
        return {"chamber": self.chamber, "digitiser": self.digitiser, "head": self.head}

    def identify(self) -> dict[str, str]:
        """Ask every instrument who it is and check that it is what the station file says.

        Returns
        -------
        dict
            What each said, by its name in the station file.

        Raises
        ------
        InstrumentError
            From the first that does not answer or is another.
        """
        return {name: device.identify() for name, device in self.devices.items()}

    def read_settings(self) -> dict[str, dict[str, str | float]]:
        """Read the settings worth keeping with a run, of every instrument."""
        return {name: dict(device.read_settings()) for name, device in self.devices.items()}

    def close(self) -> None:
        """Close every port, also when closing one fails; changes nothing in the instruments."""
        for device in self.devices.values():
            _close(device)

    def __enter__(self) -> "Station":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_station(
    config: StationConfig,
    *,
    clock: Clock | None = None,
    permit: Callable[[], None] | None = None,
) -> Station:
    """Open the instruments of a station; none is told to do anything.

    Parameters
    ----------
    config : StationConfig
        The station file.
    clock : Clock, optional
        The clock readings will be stamped with, so that the digitiser can tell by how much a
        scan was late when it had to be asked for again. Real time if not given.
    permit : callable, optional
        Called right before everything that is written to the chamber, as for `open_chamber`.

    Returns
    -------
    Station

    Raises
    ------
    LinkError
        If one cannot be opened; those that were opened are closed again.
    """
    opened: list[Device] = []

    def keep(name: str, make: Callable[[], Opened]) -> Opened:
        try:
            device = make()
        except ValueError as err:  # a URL that leads to no such instrument
            raise LinkError(f"{name}: {err}") from err
        opened.append(device)
        return device

    try:
        return Station(
            chamber=keep("chamber", lambda: open_chamber(config.chamber, permit=permit)),
            digitiser=keep("digitiser", lambda: ScanningMultimeter(config.digitiser, clock=clock)),
            head=keep("head", lambda: MotionHead(config.head)),
            config=config,
        )
    except BaseException:
        for device in opened:
            _close(device)
        raise


def _close(device: Device) -> None:
    try:
        device.close()
    except Exception as err:  # the others must still be closed
        log.warning("%s: not closed properly: %s", device.name, err)
