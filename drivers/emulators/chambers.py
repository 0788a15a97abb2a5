"""Emulated chamber controllers on real sockets and pseudo-terminals."""

from pathlib import Path
from typing import Literal

from drivers.chambers.models import CHAMBER_MODELS, import_named
from drivers.clock import Clock
from drivers.emulators.chamber_bank import Controller, Loop
from drivers.emulators.faults import FaultPlan
from drivers.emulators.modbus_server import ModbusServer, Transport
from drivers.emulators.plant import Plant
from drivers.emulators.served import Served


class ChamberEmulator(Served):
    """A chamber controller on a real socket or pseudo-terminal.

    Parameters
    ----------
    model : str
        As in the station file.
    plant : Plant
        The chamber's physics.
    clock : Clock
        The emulation's time.
    faults : FaultPlan
        What goes wrong.
    transport : "tcp", "rtu+tcp" or "rtu"
    unit_id, decimals : int
        As in the station file.
    word_order : "low" or "high"
        As in the station file.
    limits_c : (float, float)
        The controller's own set point limits, °C.
    trip_c : float
        Temperature at which the limit controller trips, °C.
    host, port, path
        Where to listen; port 0 takes a free one. `path` is the symbolic link to the
        pseudo-terminal, None: in a new temporary directory.
    """

    def __init__(
        self,
        model: str,
        plant: Plant,
        clock: Clock,
        faults: FaultPlan,
        *,
        transport: Transport = "tcp",
        unit_id: int = 1,
        decimals: int = 1,
        word_order: Literal["low", "high"] = "low",
        limits_c: tuple[float, float] = (-75.0, 180.0),
        trip_c: float = 100.0,
        host: str = "127.0.0.1",
        port: int = 0,
        path: Path | None = None,
    ) -> None:
        now_s = clock.now_s()
        start_c = min(max(plant.air_temp_c(now_s), limits_c[0]), limits_c[1])
        loop = Loop(plant, faults, start_c=start_c, now_s=now_s, trip_c=trip_c)
        controller: type[Controller] = import_named(CHAMBER_MODELS[model].emulator)
        self.controller = controller(
            loop, clock, decimals=decimals, word_order=word_order, limits_c=limits_c
        )
        self._server = ModbusServer(
            self.controller, faults, transport=transport, unit_id=unit_id,
            host=host, port=port, path=path,
        )  # fmt: skip
