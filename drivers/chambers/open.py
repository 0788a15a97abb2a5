"""Opening the chamber of a station file with the driver of its model."""

from collections.abc import Callable, Mapping

from drivers.chambers.modbus_chamber import ModbusChamber
from drivers.chambers.models import CHAMBER_MODELS, import_named
from drivers.devices import Chamber
from drivers.station import ChamberConfig


def open_chamber(
    config: ChamberConfig,
    *,
    permit: Callable[[], None] | None = None,
    recognition: Mapping[str, float | str] | None = None,
) -> Chamber:
    """Make the driver of a chamber; the port is opened with the first question.

    Parameters
    ----------
    config : ChamberConfig
        The chamber's section of the station file.
    permit : callable, optional
        Called right before every write; what it raises (`FencedError`) keeps it from being sent.
    recognition : mapping, optional
        `Chamber.recognition` of another process that recognised the same controller. The
        controller is then compared with it, in place of what a sound chamber shows: a sensor
        that has failed since does not matter, anything that differs does.

    Returns
    -------
    Chamber

    Raises
    ------
    ValueError
        If the URL is none that leads to a Modbus controller.
    """
    driver: type[ModbusChamber] = import_named(CHAMBER_MODELS[config.model].driver)
    return driver(config, permit=permit, recognition=recognition)
