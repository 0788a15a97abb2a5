"""Experiments that separate effects, as sequences for `run`."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from thermo.planning.sequence import (
    Hold,
    Positions,
    Ramp,
    Rest,
    Sampling,
    Sequence,
    TemperatureProgramme,
    TestedAccelerometer,
)
from thermo.recording.channel import Channel

EVERY_45 = (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0)
EVERY_15 = tuple(15.0 * k for k in range(24))
DWELL_READINGS = 6
# Only positions every 15° separate a cubed input from a readout nonlinearity, with a seventh of its
# strength, so three runs are needed. If an accelerometer is turned on the head, its own errors turn
# with it and the errors of the head do not. A quarter turn reverses an angle error with two periods
# per turn; half of that shifts it into quadrature. The first is the larger change. The second is
# used if the existing runs have only four positions, where that error is zero.
TURNED_DEG = (45.0, 90.0)
# A lag of τ behind a bias of slope b is −b·τ·dT/dt + b·τ²·d²T/dt² − …: a rate term in every steady
# ramp. A change of b with temperature gives little information, since a rate term may change in the
# same way. The second derivative separates them; it is largest at the reversals of ramps. A chamber
# and a case
# of some 75 s each pass ω²·|H(ω)| best at reversals every 4 to 8 minutes; the longer ones leave the
# rate, a slope over two minutes, right to 2 %.
FAST_CYCLES = (8, 32)
REVERSAL_C, REVERSALS = 22.0, (192, 384)
QUICK_PERIOD_S = 2.0
SOAK_MIN = 30.0
# Limits of an ordinary bench chamber, °C and °C/min.
COLDEST_C, HOTTEST_C, SLOWEST, FASTEST = -40.0, 70.0, 0.2, 3.0
Segment = Hold | Ramp


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of a laboratory.

    Attributes
    ----------
    most_hours : float
        An experiment is no longer.
    temperatures_c : (float, float), optional
        Coldest and hottest; by default those recorded.
    angles_deg : tuple of float, optional
        Positions of the head; by default what an experiment asks for.
    """

    most_hours: float = math.inf
    temperatures_c: tuple[float, float] | None = None
    angles_deg: tuple[float, ...] | None = None


NO_LIMITS = Limits()


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """One experiment of the menu: its description and its sequence."""

    text: str
    sequence: Sequence


def menu(channel: Channel, limits: Limits = NO_LIMITS) -> Iterator[Item]:
    """Yield the experiments that an accelerometer's runs suggest, the shortest kinds first.

    They stay within the temperatures recorded, and within what a bench chamber does, unless the
    laboratory says what it can do.
    """
    for item in _every(channel, limits.temperatures_c or _range(channel)):
        if limits.angles_deg is None:
            yield item
            continue
        at = item.sequence.positions.model_copy(update={"angles_deg": limits.angles_deg})
        text = _WITH_ANGLES.sub(f"at {_listed(limits.angles_deg)}", item.text)
        yield Item(text=text, sequence=item.sequence.model_copy(update={"positions": at}))


_WITH_ANGLES = re.compile(r"(with )?positions every \d+° in random order")


def _listed(angles_deg: tuple[float, ...]) -> str:
    return ", ".join(f"{a:g}°" for a in angles_deg)


def _every(channel: Channel, range_c: tuple[float, float]) -> Iterator[Item]:
    lo, hi = range_c
    rate = _usual_rate(channel)
    slow, fast = (float(np.clip(rate * f, SLOWEST, FASTEST)) for f in (0.5, 2.0))
    middle, quarter = 0.5 * (lo + hi), lo + 0.25 * (hi - lo)
    up_down = [_ramp(hi, rate), _hold(SOAK_MIN), _ramp(lo, rate)]
    yield Item(
        text=f"a run at {rate:g} °C/min with positions every 45° in random order",
        sequence=_sequence(channel, "45 degrees in random order", lo, up_down, 1, 0.0),
    )
    for turned in TURNED_DEG:
        yield Item(
            text=f"mount the accelerometer turned by {turned:g}° on the head, and three runs at "
            f"{rate:g} °C/min with positions every 15° in random order",
            sequence=_sequence(
                channel, f"turned by {turned:g} degrees", lo, up_down, 3, 1.0, turned, EVERY_15
            ),
        )
    two_rates = [
        *(_ramp(hi, fast), _hold(SOAK_MIN), _ramp(lo, fast), _hold(SOAK_MIN)),
        *(_ramp(hi, slow), _hold(SOAK_MIN), _ramp(lo, slow)),
    ]
    yield Item(
        text=f"a run with ramps at {fast:g} and {slow:g} °C/min, positions every 45° in random "
        "order",
        sequence=_sequence(channel, "two ramp rates", lo, two_rates, 1, 0.0),
    )
    stair = [
        step
        for to_c in (*np.linspace(lo, hi, 5)[1:], *np.linspace(hi, lo, 5)[1:])
        for step in (_ramp(float(to_c), fast), _hold(40.0))
    ]
    yield Item(
        text=f"a stair of four steps up and down at {fast:g} °C/min with holds of 40 min",
        sequence=_sequence(channel, "stair with holds", lo, stair, 1, 0.0),
    )
    for count in FAST_CYCLES:
        ramps: list[Segment] = [_ramp(to_c, FASTEST) for _ in range(count) for to_c in (hi, lo)]
        yield Item(
            text=f"{count} times up and down at {FASTEST:g} °C/min without a hold",
            sequence=_sequence(channel, "fast cycles", lo, ramps, 1, 0.0),
        )
    for count, centre in product(REVERSALS, (lo + 0.5 * REVERSAL_C, hi - 0.5 * REVERSAL_C)):
        yield Item(
            text=f"{count} reversals between {centre - 0.5 * REVERSAL_C:.0f} and "
            f"{centre + 0.5 * REVERSAL_C:.0f} °C at {FASTEST:g} °C/min, read every "
            f"{QUICK_PERIOD_S:g} s at one position",
            sequence=_reversals(channel, centre, count),
        )
    inner = [
        *(_ramp(middle, rate), _ramp(quarter, rate), _ramp(hi, rate), _hold(SOAK_MIN)),
        *(_ramp(middle, rate), _ramp(hi, rate), _ramp(lo, rate), _hold(SOAK_MIN)),
    ]
    yield Item(
        text=f"inner loops that reverse half way, at {rate:g} °C/min",
        sequence=_sequence(channel, "inner loops", lo, inner, 1, 0.0),
    )
    yield Item(
        text=f"the run at {rate:g} °C/min four times with rests of 6 h between",
        sequence=_sequence(channel, "repeats after rests", lo, up_down, 4, 6.0),
    )


def _range(channel: Channel) -> tuple[float, float]:
    lo = max(COLDEST_C, float(round(float(channel.temp_c.min()))))
    hi = min(HOTTEST_C, float(round(float(channel.temp_c.max()))))
    return (lo, hi) if hi - lo > 5.0 else (lo, lo + 40.0)


def _usual_rate(channel: Channel) -> float:
    rate = np.abs(channel.record["rate_c_per_min"][channel.direction != 0])
    usual = float(np.median(rate)) if rate.size else 1.0
    return float(np.clip(np.round(usual, 1), SLOWEST, FASTEST))


def _ramp(to_c: float, rate: float) -> Ramp:
    return Ramp(kind="ramp", to_c=to_c, rate_c_per_min=rate)


def _hold(minutes: float) -> Hold:
    return Hold(kind="hold", duration_min=minutes)


def _reversals(channel: Channel, centre_c: float, count: int) -> Sequence:
    """Return repeatedly reversed ramps with fast readings at one position."""
    low, high = centre_c - 0.5 * REVERSAL_C, centre_c + 0.5 * REVERSAL_C
    ramps: list[Segment] = [_ramp(to_c, FASTEST) for _ in range(count // 2) for to_c in (high, low)]
    usual = _sequence(channel, "quick reversals", low, ramps, 1, 0.0, angles_deg=(0.0,))
    sampling = Sampling(period_s=QUICK_PERIOD_S, settle_s=0.5)
    return usual.model_copy(update={"sampling": sampling})


def _sequence(
    channel: Channel,
    name: str,
    lo: float,
    segments: list[Segment],
    repeats: int,
    rest_h: float,
    mount_deg: float = 0.0,
    angles_deg: tuple[float, ...] = EVERY_45,
) -> Sequence:
    return Sequence(
        name=name,
        accelerometers=(
            TestedAccelerometer(
                serial=channel.serial,
                nominal_scale=abs(channel.nominal_scale),
                mount_deg=mount_deg,
            ),
        ),
        temperature=TemperatureProgramme(
            start_c=lo,
            start_soak_min=SOAK_MIN,
            segments=(_hold(SOAK_MIN), *segments, _hold(SOAK_MIN)),
            repeats=repeats,
            rest_h=rest_h,
            rest=Rest(),
        ),
        positions=Positions(
            angles_deg=angles_deg,
            order="random",
            seed=1,
            readings_per_position=DWELL_READINGS,
        ),
        sampling=Sampling(period_s=10.0, settle_s=0.5),
    )
