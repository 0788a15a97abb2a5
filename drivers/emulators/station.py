"""A whole emulated station: chamber, digitiser and head on the ports a station file names."""

import logging
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

from drivers.clock import Clock
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import FaultPlan
from drivers.emulators.motion import HeadEmulator
from drivers.emulators.multimeter import MultimeterEmulator
from drivers.emulators.plant import Plant
from drivers.links.modbus import Transport, parse_modbus_url
from drivers.station import ChamberConfig, FaultKind, PanelAction, StationConfig

log = logging.getLogger(__name__)

LATE = 1.5  # a late reply comes after this many times the asker's patience
SCAN_S = 0.15  # what an asker allows for each channel of a scan besides
TRIP_ABOVE_C = 15.0
CONTROLLER_LIMITS_C = (-75.0, 180.0)


class Emulator(Protocol):
    """An emulated instrument."""

    @property
    def url(self) -> str:
        """URL at which it is reached, once started."""
        ...

    def start(self) -> None:
        """Open the port and serve."""
        ...

    def close(self) -> None:
        """Stop serving."""
        ...


class EmulatedStation:
    """The instruments of a station file, emulated on one plant; a context manager.

    Parameters
    ----------
    config : StationConfig
        Each URL is honoured: a TCP address is bound as given, port 0 picks a free one; at
        ``serial:///some/path`` or ``modbus+rtu:///some/path`` a symbolic link to the
        pseudo-terminal is made and removed at the end; with ``auto`` for the path it is made in
        a directory of its own. Its faults are planned from the moment of starting.
    plant : Plant
        The physics.
    clock : Clock
        The emulation's clock.

    Raises
    ------
    ValueError
        If a URL is of no known kind.
    """

    def __init__(self, config: StationConfig, plant: Plant, clock: Clock) -> None:
        self._wanted = config
        self._plant = plant
        self._clock = clock
        self._config: StationConfig | None = None
        self._emulators: dict[str, Emulator] = {}
        self._faults: dict[str, FaultPlan] = {}

    @property
    def config(self) -> StationConfig:
        """The station file with the URLs at which the emulators are reached.

        Raises
        ------
        RuntimeError
            If the station was not started.
        """
        if self._config is None:
            raise RuntimeError("the emulated station was not started")
        return self._config

    @property
    def faults(self) -> dict[str, FaultPlan]:
        """Fault plan of each instrument by name; empty before the start."""
        return dict(self._faults)

    def inject(
        self,
        device: str,
        kind: FaultKind,
        *,
        count: int = 1,
        duration_s: float | None = None,
        temp_c: float | None = None,
    ) -> None:
        """Let a fault begin now.

        Parameters
        ----------
        device : str
            "chamber", "digitiser" or "head".
        kind, count, duration_s, temp_c
            As `drivers.emulators.faults.FaultPlan.inject` takes them.

        Raises
        ------
        ValueError
            If there is no such device or fault.
        """
        if device not in self._faults:
            raise ValueError(f"device {device!r}, expected one of {', '.join(self._faults)}")
        plan = self._faults[device]
        plan.inject(kind, count=count, duration_s=duration_s, temp_c=temp_c)

    def operator(self, action: PanelAction, temp_c: float | None = None) -> None:
        """Do at once what somebody does at the chamber's panel.

        Parameters
        ----------
        action : PanelAction
            "setpoint_changed", "loop_off" or "foreign_profile".
        temp_c : float, optional
            The set point he enters, °C; 20 °C more than the present one if not given.

        Raises
        ------
        ValueError
            If the model has no such thing.
        RuntimeError
            If the station was not started.
        """
        chamber = self._emulators.get("chamber")
        if not isinstance(chamber, ChamberEmulator):
            raise RuntimeError("the emulated station was not started")
        chamber.controller.operate(action, temp_c)

    def start(self) -> None:
        """Start the three; when one cannot be started, none is left running.

        Raises
        ------
        OSError
            If an address is taken or a link cannot be made.
        """
        self._faults = self._plan_faults()
        try:
            for name, emulator in self._made():
                self._emulators[name] = emulator
                emulator.start()
        except BaseException:
            self.close()
            raise
        wanted = self._wanted
        urls = {name: {"url": emulator.url} for name, emulator in self._emulators.items()}
        self._config = wanted.model_copy(
            update={
                "chamber": wanted.chamber.model_copy(update=urls["chamber"]),
                "digitiser": wanted.digitiser.model_copy(update=urls["digitiser"]),
                "head": wanted.head.model_copy(update=urls["head"]),
            }
        )

    def close(self) -> None:
        """Stop all three, also when stopping one fails; harmless when done twice."""
        while self._emulators:
            name, emulator = self._emulators.popitem()
            try:
                emulator.close()
            except Exception as err:  # the others must still be stopped
                log.warning("emulated %s: not stopped properly: %s", name, err)

    def __enter__(self) -> "EmulatedStation":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ---- making them

    def _plan_faults(self) -> dict[str, FaultPlan]:
        """Return a plan for each instrument, late by more than its driver waits."""
        wanted = self._wanted
        planned = wanted.emulation.faults if wanted.emulation is not None else ()
        scan_s = 2 * len(wanted.inputs) * SCAN_S
        late_s = {
            "chamber": LATE * wanted.chamber.timeout_s,
            "digitiser": LATE * wanted.digitiser.timeout_s + scan_s,
            "head": LATE * wanted.head.timeout_s,
        }
        return {
            name: FaultPlan(planned, name, self._clock, late_s=late)
            for name, late in late_s.items()
        }

    def _made(self) -> list[tuple[str, Emulator]]:
        wanted, plant, clock = self._wanted, self._plant, self._clock
        return [
            ("chamber", _chamber(wanted.chamber, plant, clock, self._faults["chamber"])),
            (
                "digitiser",
                MultimeterEmulator(
                    plant, clock, self._faults["digitiser"], url=wanted.digitiser.url
                ),
            ),
            (
                "head",
                HeadEmulator(
                    plant, clock, self._faults["head"], url=wanted.head.url, axis=wanted.head.axis
                ),
            ),
        ]


def _chamber(
    config: ChamberConfig, plant: Plant, clock: Clock, faults: FaultPlan
) -> ChamberEmulator:
    """Return the emulated chamber a section of the station file asks for."""
    transport, host, port, path = _modbus_port(config.url)
    lo, hi = config.limits_c
    return ChamberEmulator(
        config.model,
        plant,
        clock,
        faults,
        transport=transport,
        unit_id=config.unit_id,
        decimals=config.decimals,
        word_order=config.word_order,
        limits_c=(min(lo, CONTROLLER_LIMITS_C[0]), max(hi, CONTROLLER_LIMITS_C[1])),
        trip_c=hi + TRIP_ABOVE_C,
        host=host,
        port=port,
        path=path,
    )


def _modbus_port(url: str) -> tuple[Transport, str, int, Path | None]:
    """Return transport, host, port and link path; no path where one is to be picked."""
    parts = urlsplit(url)
    if parts.scheme == "modbus+rtu" and (parts.netloc + parts.path).strip("/") == "auto":
        return "rtu", "", 0, None
    end = parse_modbus_url(url)
    if end.transport == "rtu":
        return "rtu", "", 0, Path(end.host)
    return end.transport, end.host, end.port, None
