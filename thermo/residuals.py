"""What a model leaves: per run, direction and position, over temperature, and as a loop."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from thermo.inputs import COOLING, HEATING, HOLD, Channel

# Temperature cells of the heating-minus-cooling comparison; a cell counts when each direction has
# this many readings in it, so that one tumble round more or less does not decide.
CELL_C = 2.5
MIN_READINGS = 5
DIRECTIONS: Mapping[int, str] = {HEATING: "heating", COOLING: "cooling", HOLD: "hold"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopCell:
    """Heating minus cooling of the residual in one cell of temperature."""

    temp_c: float
    heating_minus_cooling_ug: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualGroup:
    """Readings of one run, direction or position: how many, their mean and rms."""

    name: str
    n: int
    mean_ug: float
    rms_ug: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualSummary:
    """Residuals of one accelerometer, with the temperature loop that is left."""

    rms_ug: float
    by_run: tuple[ResidualGroup, ...]
    by_direction: tuple[ResidualGroup, ...]
    by_position: tuple[ResidualGroup, ...]
    loop: tuple[LoopCell, ...]

    @property
    def heating_minus_cooling_ug(self) -> float | None:
        """Median over the shared temperature range; None with one direction only."""
        if not self.loop:
            return None
        return float(np.median([c.heating_minus_cooling_ug for c in self.loop]))

    def loop_at(self, temp_c: float) -> float | None:
        """Return heating minus cooling at a temperature, µg; None outside the shared range."""
        temps = np.array([c.temp_c for c in self.loop])
        if temps.size == 0 or not temps.min() - CELL_C / 2 <= temp_c <= temps.max() + CELL_C / 2:
            return None
        return float(np.interp(temp_c, temps, [c.heating_minus_cooling_ug for c in self.loop]))


def summarise(channel: Channel, residual_ug: FloatArray) -> ResidualSummary:
    """Sort the residuals of a channel.

    Parameters
    ----------
    channel : Channel
    residual_ug : ndarray, shape (n,)
    """
    run = channel.record.run
    positions = np.round(channel.position_deg, 1)
    known = ~np.isnan(positions)
    angles: list[float] = np.unique(positions[known]).tolist()
    return ResidualSummary(
        rms_ug=_rms(residual_ug),
        by_run=tuple(_group(r, residual_ug[run == k]) for k, r in enumerate(channel.run_ids)),
        by_direction=tuple(
            _group(name, residual_ug[channel.direction == d])
            for d, name in DIRECTIONS.items()
            if np.any(channel.direction == d)
        ),
        by_position=tuple(_group(f"{a:g}°", residual_ug[positions == a]) for a in angles),
        loop=_loop(channel, residual_ug),
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _group(name: str, values: FloatArray) -> ResidualGroup:
    return ResidualGroup(
        name=name, n=values.size, mean_ug=float(np.mean(values)), rms_ug=_rms(values)
    )


def _loop(channel: Channel, residual_ug: FloatArray) -> tuple[LoopCell, ...]:
    cell = np.floor(channel.temp_c / CELL_C).astype(int)
    cells: list[LoopCell] = []
    for k in np.unique(cell).tolist():
        up = residual_ug[(cell == k) & (channel.direction == HEATING)]
        down = residual_ug[(cell == k) & (channel.direction == COOLING)]
        if min(up.size, down.size) >= MIN_READINGS:
            difference = float(np.mean(up) - np.mean(down))
            cells.append(LoopCell(temp_c=(k + 0.5) * CELL_C, heating_minus_cooling_ug=difference))
    return tuple(cells)
