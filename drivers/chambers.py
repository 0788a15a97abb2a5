"""The chambers there are drivers for."""

from collections.abc import Callable

from drivers.chamber_eurotherm import Eurotherm3504
from drivers.chamber_f4 import WatlowF4
from drivers.chamber_f4t import WatlowF4T
from drivers.devices import Chamber
from drivers.station import ChamberConfig

_DRIVERS: dict[str, Callable[[ChamberConfig], Chamber]] = {
    "watlow_f4t": WatlowF4T,
    "watlow_f4": WatlowF4,
    "eurotherm_3504": Eurotherm3504,
}


def open_chamber(config: ChamberConfig) -> Chamber:
    """Make the driver of a chamber; the port is opened with the first question.

    Parameters
    ----------
    config : ChamberConfig
        The chamber's section of the station file.

    Returns
    -------
    Chamber

    Raises
    ------
    ValueError
        If the URL is none that leads to a Modbus controller.
    """
    return _DRIVERS[config.model](config)
