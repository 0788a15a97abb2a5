"""A sequence's temperature programme spelt out: legs with their times, and what follows of them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermo.planning.sequence import (
    MIN_RAMP_C,
    Hold,
    Positions,
    Ramp,
    TemperatureCycle,
    TemperatureProgramme,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """One stretch of the programme, at a uniform rate; times from the run's start.

    A hold whose temperature differs from the one reached before is a step: `step_c` says by how
    much the chamber has to move first, as fast as it does.
    """

    index: int
    start_s: float
    end_s: float
    start_c: float
    end_c: float
    step_c: float
    positions: Positions | None

    @property
    def rate_c_per_min(self) -> float:
        """The commanded rate, signed; 0 for a hold."""
        return 60 * (self.end_c - self.start_c) / (self.end_s - self.start_s)

    @property
    def is_ramp(self) -> bool:
        """True when the temperature is to move."""
        return self.end_c != self.start_c


def expand(programme: TemperatureProgramme) -> tuple[Leg, ...]:
    """Spell out one run of a temperature programme.

    Parameters
    ----------
    programme : TemperatureProgramme

    Returns
    -------
    tuple of Leg
        In order, without gaps; `Leg.index` is what the store calls the segment.
    """
    legs: list[Leg] = []
    time_s, temp_c = 0.0, programme.start_c
    for step in _steps(programme):
        target_c = temp_c if isinstance(step, Hold) and step.temp_c is None else _target_c(step)
        if isinstance(step, Hold):
            start_c, duration_s = target_c, 60 * step.duration_min
        else:
            start_c = temp_c
            duration_s = 60 * abs(target_c - temp_c) / step.rate_c_per_min
        legs.append(
            Leg(
                index=len(legs),
                start_s=time_s,
                end_s=time_s + duration_s,
                start_c=start_c,
                end_c=target_c,
                step_c=start_c - temp_c,
                positions=step.positions,
            )
        )
        time_s, temp_c = time_s + duration_s, target_c
    return tuple(legs)


def _target_c(step: Hold | Ramp) -> float:
    if isinstance(step, Ramp):
        return step.to_c
    assert step.temp_c is not None
    return step.temp_c


def _steps(programme: TemperatureProgramme) -> Iterator[Hold | Ramp]:
    temp_c = programme.start_c
    for segment in programme.segments:
        steps = (
            _cycle(segment, temp_c) if isinstance(segment, TemperatureCycle) else iter((segment,))
        )
        for step in steps:
            if isinstance(step, Ramp):
                temp_c = step.to_c
            elif step.temp_c is not None:
                temp_c = step.temp_c
            yield step


def _cycle(cycle: TemperatureCycle, temp_c: float) -> Iterator[Hold | Ramp]:
    targets = [cycle.low_c] if abs(temp_c - cycle.low_c) >= MIN_RAMP_C else []
    targets += [cycle.high_c, cycle.low_c] * cycle.count
    for target_c in targets:
        yield Ramp(
            kind="ramp",
            to_c=target_c,
            rate_c_per_min=cycle.rate_c_per_min,
            positions=cycle.positions,
        )
        if cycle.soak_min > 0:
            yield Hold(
                kind="hold",
                temp_c=target_c,
                duration_min=cycle.soak_min,
                positions=cycle.positions,
            )


def commanded_c(legs: tuple[Leg, ...], time_s: ArrayLike) -> FloatArray:
    """Return the temperature commanded at times of a run.

    Parameters
    ----------
    legs : tuple of Leg
    time_s : array_like, shape (n,) or ()
        From the run's start, s; before it and after the end the nearest temperature holds.

    Returns
    -------
    ndarray, shape of `time_s`
        °C.
    """
    leg, since_s = _locate(legs, time_s)
    start_c = np.array([part.start_c for part in legs])[leg]
    rate = np.array([part.rate_c_per_min / 60 for part in legs])[leg]
    return np.asarray(start_c + rate * since_s, dtype=np.float64)


def lagged_c(legs: tuple[Leg, ...], time_s: ArrayLike, lag_s: float) -> FloatArray:
    """Return the temperature of a body that follows the commanded one with one time constant.

    It stands at the first leg's temperature when the run begins. Exact within each leg: for an
    input u₀ + r·t the answer is u₀ + r·(t − τ) + (T₀ − u₀ + r·τ)·exp(−t/τ).

    Parameters
    ----------
    legs : tuple of Leg
    time_s : array_like, shape (n,) or ()
        From the run's start, s.
    lag_s : float
        Time constant τ > 0, s.

    Returns
    -------
    ndarray, shape of `time_s`
        °C.
    """
    rates = [part.rate_c_per_min / 60 for part in legs]
    excess: list[float] = []
    body_c = legs[0].start_c - legs[0].step_c
    for part, rate in zip(legs, rates, strict=True):
        excess.append(body_c - part.start_c + rate * lag_s)
        span_s = part.end_s - part.start_s
        body_c = part.end_c - rate * lag_s + excess[-1] * np.exp(-span_s / lag_s)
    leg, since_s = _locate(legs, time_s)
    start_c = np.array([part.start_c for part in legs])[leg]
    rate = np.array(rates)[leg]
    decay = np.exp(-since_s / lag_s)
    return np.asarray(
        start_c + rate * (since_s - lag_s) + np.array(excess)[leg] * decay, dtype=np.float64
    )


def leg_at(legs: tuple[Leg, ...], time_s: ArrayLike) -> NDArray[np.intp]:
    """Return the index of the leg each time belongs to; a leg owns its start, not its end."""
    starts = np.array([part.start_s for part in legs])
    # a slot that falls on a boundary belongs to the leg that begins there, rounding or not
    found = np.searchsorted(starts, np.asarray(time_s) + 1e-6, side="right") - 1
    return np.clip(found, 0, len(legs) - 1)


def _locate(legs: tuple[Leg, ...], time_s: ArrayLike) -> tuple[NDArray[np.intp], FloatArray]:
    time = np.asarray(time_s, dtype=np.float64)
    leg = leg_at(legs, time)
    start_s = np.array([part.start_s for part in legs])[leg]
    length_s = np.array([part.end_s - part.start_s for part in legs])[leg]
    return leg, np.clip(time - start_s, 0.0, length_s)
