"""The true motion of a SINS on a rig: exact at any rate, with no integration of its own.

The axis of rotation is fixed to the earth, nearly horizontal; the SINS sits on the platform with a
mounting error. With e the instrument axis of the cycle and α the angle,
``C_nb(t) = C_n0 · R(e, α(t)) · exp(δ ×)``, so that every attitude is a closed form; mean rates are
those of the angle itself, and what the earth adds is integrated by Gauss's rule of three points.
"""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray, freeze, readonly, readonly_int
from sinscal.attitude import rotation, skew
from sinscal.earth import Site
from sinscal.programme import AngleLaw, Cycle, Programme, angle_law
from sinscal.run import AXES
from sinscal.sensors import Motion

_GAUSS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFaults:
    """What a real rig does wrong; all zero is a perfect one.

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
    harmonics : tuple of (order, sine, cosine)
        The encoder's error, rad, by periods in a turn.
    """

    axis_tilt_rad: tuple[float, ...] = (0.0,)
    azimuth_error_rad: tuple[float, ...] = (0.0,)
    mount_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    remount_rad: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    eccentric_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clock_offset_s: float = 0.0
    harmonics: tuple[tuple[int, float, float], ...] = ()


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
    """

    motion: Motion
    c_nb: FloatArray
    c_start: FloatArray
    angle: FloatArray
    turn: FloatArray


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
        """Of every row, shape (n,)."""
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
        turned = rotation(law.at(at_s)[0][:, None] * unit)
        return zero @ turned @ mount

    angle, turn, _ = law.at(edges)
    w = (np.diff(angle) / step)[:, None] * along
    f = np.zeros((n, 3))
    tangential = skew(along) @ np.array(faults.eccentric_m)
    centripetal = skew(along) @ tangential
    up = np.array([0.0, 0.0, site.gravity_m_s2])
    for place, weight in zip(*_GAUSS, strict=True):
        at_s = edges[:-1] + 0.5 * step * (1.0 + float(place))
        c_bn = np.swapaxes(attitude(at_s), 1, 2)
        share = 0.5 * float(weight)
        w += share * (c_bn @ site.earth_rate)
        f += share * (c_bn @ up)
        _, speed, change = law.at(at_s)
        f += share * (speed**2)[:, None] * centripetal
        f += share * change[:, None] * tangential
    dw = (np.diff(turn) / step)[:, None] * along
    motion = Motion(time_s=edges[1:], step_s=np.full(n, step), w=w, f=f, dw=dw)
    c_nb = attitude(edges)
    return CycleMotion(
        motion=motion, c_nb=c_nb[1:], c_start=c_nb[0], angle=angle[1:], turn=turn[1:]
    )
