"""Increments of the sensors, reconstructed from the outputs of a navigator.

A navigator's outputs obey its own equations, whatever its errors: from velocity, position and
attitude as indicated follow the rates its gyros measured and the force its accelerometers measured,
in the axes it indicates. Nothing is linear or approximate in that but the course between two
outputs, where the attitude is taken to turn uniformly and the slow rest to change in proportion to
time. With a held height the vertical force is not to be had.

References
----------
Titterton, D. H. and Weston, J. L., Strapdown Inertial Navigation Technology, 2nd ed., ch. 3: the
navigator's equations, here solved for what it measured.
"""

from dataclasses import dataclass

import numba
import numpy as np

from errormodel.arrays import FloatArray, IntArray, freeze, readonly, readonly_int
from sinscal.flight.strapdown import compiled_gravity_m_s2, compiled_radii_m, local_rates
from sinscal.frames.attitude import rotation, rotvec_of
from sinscal.frames.earth import radii_m
from sinscal.frames.quaternions import cross, plus, row_of, times
from sinscal.recording.run import NavRun

# Between outputs the attitude is followed in steps no larger than this: what turns with the body is
# then short by a 24th of its square, 4e-5, and what stands still not at all.
MAX_TURN_RAD = 0.03
FREE_HEIGHT_M = 1.0  # a height that stays within this of the first is held


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NavCycle:
    """Intervals of one cycle with n outputs: n − 1 of them, followed in N steps.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
    velocity : ndarray, shape (n, 3)
        ∫ C·f dt less what gravity at the site makes of it, from the first output on, in the
        indicated axes, m/s: C the indicated attitude, f the measured force.
    position : ndarray, shape (n, 3)
        The integral of `velocity`, m.
    c_start : ndarray, shape (3, 3)
        The first indicated attitude.
    first : ndarray of int, shape (n,)
        The first step of each interval, and N.
    step_s : ndarray, shape (N,)
    c_nb : ndarray, shape (N, 3, 3)
        Indicated attitude at the middles of the steps.
    spin : ndarray, shape (N, 3)
        How the indicated local axes turn against inertial space, in themselves, rad/s.
    w : ndarray, shape (N, 3)
        Measured rate of the body, rad/s.
    bend : ndarray, shape (n − 1,)
        By how much the attitude of an interval may differ in the mean from that of a uniform turn,
        rad: a rate that changes steadily by Δω within t makes it Δω·t/12.
    temp_c : ndarray, shape (N, 3), optional
    """

    time_s: FloatArray
    velocity: FloatArray
    position: FloatArray
    c_start: FloatArray
    first: IntArray
    step_s: FloatArray
    c_nb: FloatArray
    spin: FloatArray
    w: FloatArray
    bend: FloatArray
    temp_c: FloatArray | None = None

    def __post_init__(self) -> None:
        names = ("time_s", "velocity", "position", "c_start", "step_s", "c_nb", "spin", "w", "bend")
        freeze(
            self,
            first=readonly_int(self.first),
            **{name: readonly(getattr(self, name)) for name in names},
        )


def nav_cycle(run: NavRun, rows: slice) -> NavCycle:
    """Find what was measured behind one cycle's outputs.

    Parameters
    ----------
    run : NavRun
    rows : slice
        Of the cycle.
    """
    time_s, shown = run.time_s[rows], run.velocity[rows]
    # copies: a compiled function is compiled anew for arrays that are read-only
    lat, height, v = (np.array(a[rows]) for a in (run.lat_rad, run.height_m, run.velocity))
    spin, slowed = _by_place(lat, height, v, run.facts.site.gravity_m_s2)
    velocity = shown - shown[0] + _integral(slowed, time_s)
    position = position_errors(run, rows) - _integral(shown - velocity, time_s)

    c_nb = run.c_nb[rows]
    turn = rotvec_of(np.swapaxes(c_nb[:-1], 1, 2) @ c_nb[1:])
    parts = max(1, int(np.ceil(float(np.max(np.linalg.norm(turn, axis=1))) / MAX_TURN_RAD)))
    share = (np.arange(parts) + 0.5) / parts

    def between(values: FloatArray) -> FloatArray:
        change = np.diff(values, axis=0)[:, None]
        return (values[:-1, None] + share[:, None] * change).reshape(-1, 3)

    middle = (c_nb[:-1, None] @ rotation(share[None, :, None] * turn[:, None])).reshape(-1, 3, 3)
    length_s = np.diff(time_s)
    local = between(spin)
    rate = turn / length_s[:, None]
    change = np.diff(np.vstack([rate[:1], rate, rate[-1:]]), axis=0)
    beside = change[1:] + change[:-1]  # the rate after an interval less that before it
    return NavCycle(
        time_s=time_s,
        velocity=velocity,
        position=position,
        c_start=c_nb[0],
        first=np.arange(0, middle.shape[0] + 1, parts),
        step_s=np.repeat(length_s / parts, parts),
        c_nb=middle,
        spin=local,
        w=np.repeat(rate, parts, axis=0) + (local[:, None, :] @ middle)[:, 0],
        bend=np.linalg.norm(beside, axis=1) * length_s / 12.0,
        temp_c=None if run.temp_c is None else between(run.temp_c[rows]),
    )


def free_height(run: NavRun) -> bool:
    """Tell whether the vertical channel runs free: its height leaves the first."""
    return float(np.max(np.abs(run.height_m - run.height_m[0]))) > FREE_HEIGHT_M


def position_errors(run: NavRun, rows: slice) -> FloatArray:
    """Return how far the position has gone since the first row, east, north, up, m, shape (n, 3).

    Differences of longitude count at the computed latitude: then the sum is the integral of the
    computed velocity, however far the position has gone.
    """
    lat, lon, height = run.lat_rad[rows], run.lon_rad[rows], run.height_m[rows]
    middle = 0.5 * (lat[1:] + lat[:-1])
    radii = np.array([radii_m(float(x)) for x in middle]).reshape(-1, 2)
    level = 0.5 * (height[1:] + height[:-1])
    east = np.diff(lon) * (radii[:, 1] + level) * np.cos(middle)
    north = np.diff(lat) * (radii[:, 0] + level)
    steps = np.column_stack([east, north, np.diff(height)])
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def _integral(values: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the integral since the first row by trapezoids, shape (n, 3)."""
    parts = 0.5 * (values[1:] + values[:-1]) * np.diff(time_s)[:, None]
    return np.vstack([np.zeros(3), np.cumsum(parts, axis=0)])


@numba.njit(cache=True)
def _by_place(
    lat: FloatArray, height: FloatArray, velocity: FloatArray, gravity: float
) -> tuple[FloatArray, FloatArray]:
    """Return the spin of the local axes, and by how much C·f − γ exceeds the acceleration shown.

    The latter is (2·earth's rate + craft's rate) × velocity, and gravity where the navigator takes
    itself to be, less that of the site.
    """
    spin, slowed = np.empty((lat.size, 3)), np.empty((lat.size, 3))
    for k in range(lat.size):
        v = row_of(velocity, k)
        r_m, r_n = compiled_radii_m(lat[k])
        earth, craft = local_rates(lat[k], v, r_m + height[k], r_n + height[k])
        spin[k] = plus(earth, craft)
        slowed[k] = cross(plus(times(2.0, earth), craft), v)
        slowed[k, 2] += compiled_gravity_m_s2(lat[k], height[k]) - gravity
    return spin, slowed
