"""Initial alignment: level from the accelerometers, north from the earth's rotation.

While the SINS turns and its sensors are not yet calibrated, north cannot be had by averaging. So
the first filter works in level axes of any azimuth, in which the two horizontal parts of the
earth's rotation are linear unknowns; north is where their sum points.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from sinscal.filter.data import CycleData, Nominal
from sinscal.filter.integrate import attitudes
from sinscal.filter.layout import RigLayout
from sinscal.frames.attitude import skew
from sinscal.frames.earth import Site
from sinscal.model.sensors import SensorModel

# So long gyros that are not calibrated keep the vertical: 10 °/s with 3e-3 of error, 1.8°.
LEVEL_S = 60.0
# Of a cycle, for its axis: their noise is averaged to 1e-3 of what gyrocompassing can see.
AXIS_ROWS = 3000


def level(cycle: CycleData, sensors: SensorModel, values: FloatArray) -> FloatArray:
    """Return C at the start of a cycle in level axes of some azimuth, from its first minute."""
    measured = cycle.measured
    early = measured.take(slice(int(np.sum(measured.time_s <= measured.time_s[0] + LEVEL_S))))
    true = sensors.corrected(early, values)
    middle, _ = attitudes(true.w, true.step_s, np.eye(3), np.zeros(3))
    good = cycle.good[: len(early)]
    forces = (middle[good] @ true.f[good][:, :, None])[:, :, 0]
    up: FloatArray = np.sum(forces, axis=0)
    up = up / float(np.linalg.norm(up))
    seed = np.eye(3)[int(np.argmin(np.abs(up)))]
    east = skew(seed) @ up
    east = east / float(np.linalg.norm(east))
    return np.vstack([east, skew(up) @ east, up])


def level_nominal(
    cycles: Sequence[CycleData], sensors: SensorModel, values: FloatArray, site: Site
) -> Nominal:
    """Return a nominal in level axes of unknown azimuth: no horizontal rotation of the earth."""
    return Nominal(
        values=values,
        c_start=tuple(level(c, sensors, values) for c in cycles),
        earth=tuple(site.earth_rate * np.array([0.0, 0.0, 1.0]) for _ in cycles),
        mount=np.zeros(3),
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class North:
    """The nominal in east-north-up axes, and the sigma of each cycle's azimuth, rad."""

    nominal: Nominal
    sigma_rad: FloatArray


def find_north(nominal: Nominal, cov: FloatArray, layout: RigLayout, site: Site) -> North:
    """Turn the level axes of each cycle to north, as its horizontal rotation of the earth shows.

    Parameters
    ----------
    nominal : Nominal
        Improved by a filter of `layout`.
    cov : ndarray, shape (n, n)
        Of that filter's states.
    layout : RigLayout
        With `wander`.
    site : Site
    """
    starts: list[FloatArray] = []
    sigmas: list[float] = []
    for k, (c, earth) in enumerate(zip(nominal.c_start, nominal.earth, strict=True)):
        north = earth[:2] / max(float(np.linalg.norm(earth[:2])), 1e-30)
        turn = np.array([[north[1], -north[0], 0.0], [north[0], north[1], 0.0], [0.0, 0.0, 1.0]])
        starts.append(turn @ c)
        across = np.array([north[1], -north[0]])
        part = cov[layout.earth_rate(k), layout.earth_rate(k)]
        sigmas.append(float(np.sqrt(across @ part @ across)) / float(site.earth_rate[1]))
    turned = replace(
        nominal, c_start=tuple(starts), earth=tuple(site.earth_rate for _ in nominal.earth)
    )
    return North(nominal=turned, sigma_rad=np.array(sigmas))


def mean_axis(cycle: CycleData) -> FloatArray:
    """Return the direction in the body about which a cycle turns, as its gyros say, (3,).

    By its faster steps; positive along the cycle's instrument axis when that is known.
    """
    return _axis_of(cycle.measured.w, cycle.axis)


def _axis_of(w: FloatArray, instrument: int | None) -> FloatArray:
    _, _, rows = np.linalg.svd(w.T @ w)
    along = rows[0]
    reference = np.eye(3)[instrument] if instrument is not None else np.sign(along)
    return along if along @ reference >= 0 else -along


def found_azimuth(
    cycle: CycleData, sensors: SensorModel, values: FloatArray, c_start: FloatArray
) -> tuple[float, FloatArray]:
    """Return the azimuth of the axis a cycle turns about, and its derivative by the unknowns.

    The gyros' errors move the axis in the body: a misalignment of 3′ between cycles about other
    axes looks like 3′ between their azimuths.

    Parameters
    ----------
    cycle : CycleData
    sensors : SensorModel
    values : ndarray, shape (p,)
        Of its unknowns, with which the rates are corrected.
    c_start : ndarray, shape (3, 3)
        C_nb at the cycle's start.

    Returns
    -------
    float
        From north clockwise, rad.
    ndarray, shape (p,)
    """
    m = cycle.measured
    rows = np.arange(0, len(m), max(1, len(m) // AXIS_ROWS))
    true = sensors.corrected(m.take(rows), values)
    along = _axis_of(true.w, cycle.axis)
    turn = true.w @ along
    columns = sensors.columns(true, values)
    # the principal direction follows what goes with the turn across it
    grown = turn @ columns / float(turn @ turn)
    across = np.eye(3) - np.outer(along, along)
    axis_by = np.zeros((3, len(sensors.names)))
    for j, owner in enumerate(sensors.owner):
        if owner < 3:
            axis_by[:, j] = -across[:, owner] * grown[j]
    east, north, _ = c_start @ along
    by = c_start @ axis_by
    return azimuth_of(c_start @ along), (north * by[0] - east * by[1]) / (east**2 + north**2)


def azimuth_of(direction: FloatArray) -> float:
    """Return the azimuth of a direction in east-north-up axes, from north clockwise, rad."""
    return float(np.arctan2(direction[0], direction[1]))
