"""The chamber models there are: the one list of them, by the name that a station file gives."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True, slots=True)
class ChamberClasses:
    """Driver and emulated controller of a model, each as ``MODULE:CLASS``.

    Named and not imported: the station file's form needs the names, the drivers need that form.
    `hidden` are the actions at the panel (`drivers.station.PanelAction`) that no register of the
    controller tells, so that they cannot be emulated.
    """

    driver: str
    emulator: str
    hidden: tuple[str, ...] = ()


CHAMBER_MODELS: Mapping[str, ChamberClasses] = {
    "watlow_f4t": ChamberClasses(
        "drivers.chambers.watlow_f4t:WatlowF4T", "drivers.emulators.chamber_ramping:F4T"
    ),
    "watlow_f4": ChamberClasses(
        "drivers.chambers.watlow_f4:WatlowF4",
        "drivers.emulators.chamber_profiling:F4",
        hidden=("loop_off",),
    ),
    "eurotherm_3504": ChamberClasses(
        "drivers.chambers.eurotherm_3504:Eurotherm3504",
        "drivers.emulators.chamber_ramping:Eurotherm",
    ),
}


def import_named(name: str) -> Any:
    """Return the class that ``MODULE:CLASS`` names."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)
