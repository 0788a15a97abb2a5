"""The true motion of a SINS on a rig: exact at any rate, with no integration of its own.

The axis of rotation is fixed to the earth, nearly horizontal; the SINS sits on the platform with a
mounting error. With e the instrument axis of the cycle and α the angle,
``C_nb(t) = C_n0 · exp(ε(α) ×) · R(e, α(t)) · exp(δ ×)``, so that every attitude is a closed form (ε
is the wobble of the axis); mean rates are those of the angle itself, and what the earth and the
wobble add is integrated by Gauss's rule of three points.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray, freeze, readonly, readonly_int
from sinscal.frames.attitude import rotation, skew
from sinscal.frames.earth import Site
from sinscal.model.motion import Motion
from sinscal.recording.run import AXES
from sinscal.twin.programme import AngleLaw, Cycle, Programme, angle_law

_GAUSS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Harmonic:
    """The encoder's error sine·sin(kα) + cosine·cos(kα), rad."""

    order: int
    sine: float = 0.0
    cosine: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Wobble:
    """The rotation axis is turned by size·(cos, sin)(kα + phase) about the two axes across it."""

    order: int
    size: float
    phase: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFaults:
    """Faults of a real rig; all zero is a perfect one.

    Attributes
    ----------
    axis_tilt_rad : tuple of float
        The rotation axis points above the horizon, for each cycle (the last one for the rest).
    azimuth_error_rad : tuple of float
        Its azimuth differs from the programme's, for each cycle.
    mount_rad : tuple of three float
        The body is turned from the platform by this rotation vector: v_p = exp(δ ×) v_b.
    remount_rad : tuple of tuples of three float
        The same in addition for each cycle: platform axes that are not orthogonal, re-mounting.
    eccentric_m : tuple of three float
        The reference point of the accelerometers from the rotation axis, body axes.
    clock_offset_s : float
        The angle in the row of time t is that of t + τ.
    harmonics : tuple of Harmonic
        The encoder's error by periods in a turn.
    wobble : tuple of Wobble
        How the rotation axis moves as the platform turns.
    """

    axis_tilt_rad: tuple[float, ...] = (0.0,)
    azimuth_error_rad: tuple[float, ...] = (0.0,)
    mount_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    remount_rad: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    eccentric_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clock_offset_s: float = 0.0
    harmonics: tuple[Harmonic, ...] = ()
    wobble: tuple[Wobble, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CycleMotion:
    """The true motion of one cycle.

    Attributes
    ----------
    motion : Motion
        Step means; times from the start of the cycle.
    c_nb : ndarray, shape (n, 3, 3)
        Attitude at the ends of the steps.
    c_start : ndarray, shape (3, 3)
        Attitude before the first step.
    angle, turn : ndarray, shape (n,)
        The platform's true angle at the ends of the steps, rad, and its rate.
    law : AngleLaw
        The same at any time.
    """

    motion: Motion
    c_nb: FloatArray
    c_start: FloatArray
    angle: FloatArray
    turn: FloatArray
    law: AngleLaw


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigMotion:
    """The true motion of a whole programme."""

    site: Site
    axes: tuple[str, ...]
    azimuth_rad: float
    cycles: tuple[CycleMotion, ...]
    start_s: FloatArray

    def __post_init__(self) -> None:
        freeze(self, start_s=readonly(self.start_s))

    @property
    def cycle_numbers(self) -> IntArray:
        """Cycle number of every row, shape (n,)."""
        lengths = [len(c.motion) for c in self.cycles]
        return readonly_int(np.repeat(np.arange(len(lengths)), lengths))


def platform_at_zero(axis: int, azimuth_rad: float, tilt_rad: float) -> FloatArray:
    """Return C_np at angle zero: the cycle's axis along the rotation axis, the one after next up.

    Parameters
    ----------
    axis : int
        0, 1, 2: the instrument axis along the rotation axis.
    azimuth_rad, tilt_rad : float
        Of the rotation axis: from north clockwise, and above the horizon.

    Returns
    -------
    ndarray, shape (3, 3)
    """
    along = np.array(
        [
            np.sin(azimuth_rad) * np.cos(tilt_rad),
            np.cos(azimuth_rad) * np.cos(tilt_rad),
            np.sin(tilt_rad),
        ]
    )
    level = np.array([-np.cos(azimuth_rad), np.sin(azimuth_rad), 0.0])
    c = np.empty((3, 3))
    c[:, axis] = along
    c[:, (axis + 1) % 3] = level
    c[:, (axis + 2) % 3] = skew(along) @ level
    return c


def _of(values: tuple[float, ...], k: int) -> float:
    return values[min(k, len(values) - 1)]


def rig_motion(programme: Programme, rate_hz: float, faults: RigFaults | None = None) -> RigMotion:
    """Compute the true motion of a programme.

    Parameters
    ----------
    programme : Programme
    rate_hz : float
        Steps a second.
    faults : RigFaults, optional

    Raises
    ------
    ValueError
        If a segment is too short for its change of rate.
    """
    faults = faults or RigFaults()
    site = Site(lat_rad=float(np.deg2rad(programme.latitude_deg)), height_m=programme.height_m)
    cycles: list[CycleMotion] = []
    starts: list[float] = []
    now_s = 0.0
    azimuth = float(np.deg2rad(programme.azimuth_deg))
    for k, cycle in enumerate(programme.cycles):
        law = angle_law(cycle, programme.acceleration_deg_s2)
        zero = platform_at_zero(
            AXES.index(cycle.axis),
            azimuth + _of(faults.azimuth_error_rad, k),
            _of(faults.axis_tilt_rad, k),
        )
        more = faults.remount_rad[min(k, len(faults.remount_rad) - 1)]
        mount = rotation(np.array(faults.mount_rad) + np.array(more))
        cycles.append(_cycle_motion(cycle, law, site, zero, mount, rate_hz, faults))
        starts.append(now_s)
        now_s += law.duration_s + programme.pause_s
    return RigMotion(
        site=site,
        axes=tuple(c.axis for c in programme.cycles),
        azimuth_rad=azimuth,
        cycles=tuple(cycles),
        start_s=np.array(starts),
    )


def _cycle_motion(
    cycle: Cycle,
    law: AngleLaw,
    site: Site,
    zero: FloatArray,
    mount: FloatArray,
    rate_hz: float,
    faults: RigFaults,
) -> CycleMotion:
    n = round(law.duration_s * rate_hz)
    step = 1.0 / rate_hz
    edges = np.arange(n + 1) * step
    axis = AXES.index(cycle.axis)
    unit = np.eye(3)[axis]
    along = mount.T @ unit  # the rotation axis in the body

    def attitude(at_s: FloatArray) -> FloatArray:
        at = law.at(at_s)[0]
        turned = rotation(at[:, None] * unit)
        if faults.wobble:
            turned = rotation(_wobble(at, axis, faults)[0]) @ turned
        return zero @ turned @ mount

    angle, turn, _ = law.at(edges)
    added, f = _earth_and_rig(law, edges, attitude, axis, mount, site, faults)
    w = (np.diff(angle) / step)[:, None] * along + added
    dw = (np.diff(turn) / step)[:, None] * along
    motion = Motion(time_s=edges[1:], step_s=np.full(n, step), w=w, f=f, dw=dw)
    c_nb = attitude(edges)
    return CycleMotion(
        motion=motion, c_nb=c_nb[1:], c_start=c_nb[0], angle=angle[1:], turn=turn[1:], law=law
    )


def _earth_and_rig(
    law: AngleLaw,
    edges: FloatArray,
    attitude: Callable[[FloatArray], FloatArray],
    axis: int,
    mount: FloatArray,
    site: Site,
    faults: RigFaults,
) -> tuple[FloatArray, FloatArray]:
    """Return the steps' mean rates of earth and wobble, and mean forces, each (n, 3)."""
    along = skew(mount.T @ np.eye(3)[axis])
    tangential = along @ np.array(faults.eccentric_m)
    centripetal = along @ tangential
    up = np.array([0.0, 0.0, site.gravity_m_s2])
    # pieces of steps, cut where the acceleration changes: within each everything is smooth
    inside = (law.knot_s > 0.0) & (law.knot_s < edges[-1])
    cuts = np.unique(np.concatenate([edges, law.knot_s[inside]]))
    length, step = np.diff(cuts), edges[1] - edges[0]
    w, f = np.zeros((length.size, 3)), np.zeros((length.size, 3))
    for place, weight in zip(*_GAUSS, strict=True):
        at_s = cuts[:-1] + 0.5 * length * (1.0 + float(place))
        c_bn = np.swapaxes(attitude(at_s), 1, 2)
        share = (0.5 * float(weight) / step * length)[:, None]
        at, speed, change = law.at(at_s)
        w += share * (c_bn @ site.earth_rate)
        if faults.wobble:
            w += share * _wobble_rate(at, speed, axis, mount, faults)
        f += share * (c_bn @ up)
        f += share * ((speed**2)[:, None] * centripetal + change[:, None] * tangential)
    first = np.searchsorted(cuts, edges[:-1])
    return np.add.reduceat(w, first, axis=0), np.add.reduceat(f, first, axis=0)


def _wobble(angle: FloatArray, axis: int, faults: RigFaults) -> tuple[FloatArray, FloatArray]:
    """Return the rotation vector ε of the axis and its derivative by the angle, each (n, 3)."""
    turned, by_angle = np.zeros((angle.size, 3)), np.zeros((angle.size, 3))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    for one in faults.wobble:
        phase = one.order * angle + one.phase
        turned[:, first] += one.size * np.cos(phase)
        turned[:, second] += one.size * np.sin(phase)
        by_angle[:, first] -= one.order * one.size * np.sin(phase)
        by_angle[:, second] += one.order * one.size * np.cos(phase)
    return turned, by_angle


def _wobble_rate(
    angle: FloatArray, speed: FloatArray, axis: int, mount: FloatArray, faults: RigFaults
) -> FloatArray:
    """Return what the wobble adds to the body's rate, rad/s, shape (n, 3).

    The rate of exp(ε ×) in its own axes is J(ε)·ε̇ with J = I − ½ ε× + ⅙ (ε×)² − …; for wobbles
    of minutes of arc what is left out is below 1e-10 of it. The centrifugal force it adds at an
    eccentric point is below 1 µg and left out.
    """
    turned, by_angle = _wobble(angle, axis, faults)
    k = skew(turned)
    jacobian = np.eye(3) - 0.5 * k + (k @ k) / 6.0
    rate = jacobian @ (speed[:, None] * by_angle)[:, :, None]
    platform = np.swapaxes(rotation(angle[:, None] * np.eye(3)[axis]), 1, 2)
    return (mount.T @ (platform @ rate))[:, :, 0]
