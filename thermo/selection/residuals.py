"""Residuals of a model: per run, direction and position, over temperature, and as a loop."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray, rms
from thermo.recording.channel import COOLING, HEATING, HOLD, Channel

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
        rms_ug=rms(residual_ug),
        by_run=tuple(_group(r, residual_ug[run == k]) for k, r in enumerate(channel.run_ids)),
        by_direction=tuple(
            _group(name, residual_ug[channel.direction == d])
            for d, name in DIRECTIONS.items()
            if np.any(channel.direction == d)
        ),
        by_position=tuple(_group(f"{a:g}°", residual_ug[positions == a]) for a in angles),
        loop=_loop(channel, residual_ug),
    )


def constants_only_ug(
    output: FloatArray, a_i_g: FloatArray, own_scale: float | None = None
) -> FloatArray:
    """Return what a model without temperature leaves, its K0 and, if it can be had, K1, µg.

    It is what "raw" and "before" mean everywhere.

    Parameters
    ----------
    output : ndarray, shape (n,)
        In any unit.
    a_i_g : ndarray, shape (n,)
        Specific force along IA, local g.
    own_scale : float, optional
        Output per g that the residual is referred to the input by; by default that of this model,
        1 where it cannot be had.
    """
    columns = np.column_stack([np.ones(output.size), a_i_g])
    solution, _, rank, _ = np.linalg.lstsq(columns, output, rcond=1e-3)
    if rank < 2:
        left = output - a_i_g * (own_scale or 1.0)
        return 1e6 * (left - left.mean()) / (own_scale or 1.0)
    return 1e6 * (output - columns @ solution) / (own_scale or float(solution[1]))


def _group(name: str, values: FloatArray) -> ResidualGroup:
    return ResidualGroup(
        name=name, n=values.size, mean_ug=float(np.mean(values)), rms_ug=rms(values)
    )


def loop_cells(channel: Channel) -> tuple[IntArray, FloatArray]:
    """Return which cell of heating minus cooling each reading is in, and its weight there.

    Cells count from 0, −1 is none; both have the shape (n,).
    """
    cell, weight = np.full(channel.temp_c.size, -1, dtype=np.intp), np.zeros(channel.temp_c.size)
    for number, (_, up, down) in enumerate(_cells(channel)):
        cell[up] = cell[down] = number
        weight[up], weight[down] = 1.0 / up.size, -1.0 / down.size
    return cell, weight


def _cells(channel: Channel) -> Iterator[tuple[int, IntArray, IntArray]]:
    """Yield the cells of temperature that both directions passed, with the readings of each."""
    cell = np.floor(channel.temp_c / CELL_C).astype(int)
    for k in np.unique(cell).tolist():
        up = np.flatnonzero((cell == k) & (channel.direction == HEATING))
        down = np.flatnonzero((cell == k) & (channel.direction == COOLING))
        if min(up.size, down.size) >= MIN_READINGS:
            yield k, up, down


def _loop(channel: Channel, residual_ug: FloatArray) -> tuple[LoopCell, ...]:
    return tuple(
        LoopCell(
            temp_c=(k + 0.5) * CELL_C,
            heating_minus_cooling_ug=float(np.mean(residual_ug[up]) - np.mean(residual_ug[down])),
        )
        for k, up, down in _cells(channel)
    )
