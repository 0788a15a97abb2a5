"""What a chamber, a head and an accelerometer's case really do in a night; own physics.

Temperatures are integrated in half-second steps. Nothing of the package's models is used.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Floats = NDArray[np.floating]
Ints = NDArray[np.int64]

STEP_S = 0.5
COLD_C, HOT_C, ROOM_C = -40.0, 70.0, 25.0
SOAKS_MIN = (30.0, 30.0, 20.0)
CHAMBER_TAU_S, CASE_TAU_S = 90.0, 60.0

Corners = tuple[tuple[float, float], ...]  # (minute, °C) of one run


def there_and_back(rate_c_per_min: float) -> Corners:
    """Return the corners of a run from cold to hot to cold, with soaks."""
    ramp = (HOT_C - COLD_C) / rate_c_per_min
    legs = (0.0, SOAKS_MIN[0], ramp, SOAKS_MIN[1], ramp, SOAKS_MIN[2])
    temps = (COLD_C, COLD_C, HOT_C, HOT_C, COLD_C, COLD_C)
    return tuple(zip(np.cumsum(legs).tolist(), temps, strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class Protocol:
    """How a campaign is made: the programme of each run, and where the head goes."""

    name: str
    runs: tuple[Corners, ...]
    angles_deg: tuple[float, ...] = (0.0, 90.0, 180.0, 270.0)
    random_order: bool = False
    dwell_s: float = 600.0
    period_s: float = 10.0  # between readings
    rest_s: float = 3600.0  # between runs, powered off
    mount_deg: float = 0.0  # how far the accelerometer is mounted turned on the head


EIGHT = tuple(45.0 * k for k in range(8))
EQUAL = tuple(there_and_back(1.0) for _ in range(4))
MIXED = tuple(there_and_back(rate) for rate in (0.5, 1.0, 2.0, 1.0))
PROTOCOLS = {
    p.name: p
    for p in (
        Protocol(name="P0", runs=MIXED, random_order=True),
        Protocol(name="P1", runs=EQUAL),
        Protocol(name="P2", runs=MIXED, angles_deg=EIGHT),
        Protocol(name="P3", runs=MIXED, angles_deg=EIGHT, random_order=True),
    )
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Night:
    """All runs of a campaign, one row a reading; second axis: the two half seconds of it."""

    run: Ints
    time_s: Floats  # from the run's start
    age_s: Floats  # from the first run's start, rests included
    case_c: Floats  # (n, 2)
    flux_c_per_min: Floats  # (n, 2): heat flowing into the case
    chamber_c: Floats
    angle_deg: Floats  # commanded
    dwell: Ints
    moving: NDArray[np.bool_]
    path_c: tuple[Floats, ...]  # each run's case temperature every two seconds
    period_s: float
    mount_deg: float


def follow(x: Floats, tau_s: float) -> Floats:
    """Return x behind one thermal pole, settled at first."""
    keep = np.exp(-STEP_S / tau_s)
    out, _ = lfilter([1 - keep], [1.0, -keep], x, zi=[keep * x[0]])
    return np.asarray(out)


def run_temperatures(corners: Corners, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return chamber and case temperature of one run in half-second steps."""
    minutes, temps = zip(*corners, strict=True)
    t = np.arange(0.0, 60 * minutes[-1], STEP_S)
    cycling = 0.03 * np.sin(2 * np.pi * (t / 240 + rng.random()))
    kicks = np.concatenate([[0.0], rng.standard_normal(t.size - 1)])
    unrest = 0.02 * np.sqrt(2 * 300 / STEP_S) * follow(kicks, 300.0)  # 0.02 °C rms, five minutes
    chamber = follow(np.interp(t / 60, minutes, temps), CHAMBER_TAU_S) + cycling + unrest
    return chamber, follow(chamber, CASE_TAU_S)


def order_of_positions(protocol: Protocol, dwells: int, rng: np.random.Generator) -> Floats:
    """Return the angle of each dwell: one fixed cycle, or every cycle in an order of its own."""
    angles = np.array(protocol.angles_deg)
    cycles = -(-dwells // angles.size)
    rows = [rng.permutation(angles) if protocol.random_order else angles for _ in range(cycles)]
    return np.concatenate(rows)[:dwells]


def make_night(protocol: Protocol, rng: np.random.Generator) -> Night:
    """Run a campaign."""
    parts: list[dict[str, NDArray[np.generic]]] = []
    paths: list[Floats] = []
    age = 0.0
    period = protocol.period_s
    for number, corners in enumerate(protocol.runs):
        chamber, case = run_temperatures(corners, rng)
        time_s = np.arange(period, chamber.size * STEP_S, period)
        at = (time_s / STEP_S).astype(int)[:, None] - np.array([2, 1])  # the second before it
        flux = 60 * (chamber - case) / CASE_TAU_S
        dwell = ((time_s - period) // protocol.dwell_s).astype(np.int64)
        angles = order_of_positions(protocol, int(dwell[-1]) + 1, rng)
        first = np.diff(dwell, prepend=-1) > 0
        parts.append(
            {
                "run": np.full(time_s.size, number),
                "time_s": time_s,
                "age_s": age + time_s,
                "case_c": case[at],
                "flux_c_per_min": follow(flux, 5.0)[at],
                "chamber_c": chamber[at[:, 1]],
                "angle_deg": angles[dwell],
                "dwell": dwell,
                "moving": first & (dwell > 0),
            }
        )
        paths.append(case[::4])
        age += chamber.size * STEP_S + protocol.rest_s
    joined = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
    turned = protocol.mount_deg
    return Night(path_c=tuple(paths), period_s=period, mount_deg=turned, **joined)  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True, eq=False)
class Relays:
    """A Preisach ensemble: each relay goes up at `up` and down at `down`, °C."""

    up: Floats
    down: Floats

    def walk(self, path_c: Floats) -> Floats:
        """Return the mean state, −1 to 1, along a path that came down from room temperature."""
        state = np.where(0.5 * (self.up + self.down) < ROOM_C, 1.0, -1.0)
        state[self.down > path_c[0]] = -1.0
        out, last, mean = np.empty(path_c.size), path_c[0], state.mean()
        for k, temp in enumerate(path_c):
            if abs(temp - last) > 0.02:  # the relays are 0.05 °C apart
                state[self.up < temp] = 1.0
                state[self.down > temp] = -1.0
                last, mean = temp, state.mean()
            out[k] = mean
        return out


@cache
def relays(width_c: float, number: int = 3000) -> Relays:
    """Return relays whose widths are spread (gamma, order 2), denser where it is cold.

    That is no one-parameter loop: its branches curve otherwise near a reversal than an
    exponential does, and its height changes by a third over the temperature.
    """
    share = (np.arange(number) + 0.5) / number
    golden = (np.arange(number) * 0.6180339887498949) % 1.0
    widths = np.interp(golden, *_gamma_two_quantiles(width_c))
    centres = -90.0 + 210.0 * share**1.15
    return Relays(centres + widths / 2, centres - widths / 2)


def _gamma_two_quantiles(mean: float) -> tuple[Floats, Floats]:
    x = np.linspace(0.0, 6 * mean, 2000)
    s = 2 * x / mean
    return 1 - (1 + s) * np.exp(-s), x
