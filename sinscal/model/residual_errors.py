"""Errors that a calibration leaves in the sensors, as parameters with a covariance.

The sensors and the names of their parameters are those of `sinscal.library`; what is left of a
parameter after compensation is an error of the same form.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.terms import Description
from sinscal.library import RigLibrary, rig_library
from sinscal.library.angle import MOUNT
from sinscal.library.groups import Group
from sinscal.library.jump import DRIFTS, JUMPS
from sinscal.model.motion import Motion
from sinscal.model.sensors import SensorModel, as_vector, sensor_model

# Share of a passing change that a constant error has reached when the run is over.
REACHED = {**dict.fromkeys(JUMPS, 1.0), **{one.name: 0.5 for one in DRIFTS}}
SYMMETRY = 1e-6  # of correlations
# Rounding in a filter leaves the correlation matrix this short of no negative variance.
NEGATIVE = 1e-8


def flies(group: Group) -> bool:
    """Return whether errors of a group go with the sensors into flight.

    The rig's own stay on the rig, and a flight is at the reference temperature.
    """
    return not (group.needs_angle or group.needs_temperature)


def _in_flight(one: Description) -> bool:
    """Return whether a parameter goes into flight; a jump is over, the mounting stays behind."""
    if one.group == MOUNT or one.group in REACHED:
        return False
    known = rig_library().groups
    return one.group not in known or flies(known[one.group])


def flying_sensors(groups: tuple[str, ...] | None = None) -> SensorModel:
    """Return the sensors with the groups named, by default all that act at one temperature."""
    known = rig_library()
    if groups is None:
        groups = tuple(name for name, group in known.groups.items() if flies(group))
    return _sensors_of(known, groups)


@cache
def _sensors_of(known: RigLibrary, groups: tuple[str, ...]) -> SensorModel:
    del known  # the same names in another library are other terms
    return sensor_model(groups)


def _with(names: Iterable[str]) -> SensorModel:
    """Return the sensors with no more terms than the parameters need: columns take time."""
    return flying_sensors(tuple(dict.fromkeys(rig_library().parameter(n).family for n in names)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Calibration:
    """Covariance of the errors that a calibration leaves in the sensors.

    Attributes
    ----------
    names : tuple of str
        Parameters of the sensors, by the names of `sinscal.library`.
    cov : ndarray, shape (m, m)
        Covariance of what compensation leaves of them, SI.

    Raises
    ------
    ValueError
        If names are unknown or double, or the matrix is no covariance of theirs.
    """

    names: tuple[str, ...]
    cov: FloatArray

    def __post_init__(self) -> None:
        freeze(self, cov=readonly(self.cov))
        m = len(self.names)
        known = set(flying_sensors().names)
        unknown = [name for name in self.names if name not in known]
        if unknown:
            raise ValueError(f"{unknown[0]} is not a parameter of a gyro or an accelerometer")
        if len(set(self.names)) != m:
            raise ValueError("a parameter is listed twice among the names")
        if m == 0 or self.cov.shape != (m, m):
            raise ValueError(f"the covariance has shape {self.cov.shape}, expected ({m}, {m})")
        if not np.isfinite(self.cov).all() or np.diag(self.cov).min() < 0.0:
            raise ValueError("expected finite values and no negative variance in the covariance")
        sigma = np.sqrt(np.diag(self.cov))
        scale = np.where(sigma > 0.0, sigma, 1.0)
        correlation = self.cov / np.outer(scale, scale)
        if np.abs(correlation - correlation.T).max() > SYMMETRY:
            raise ValueError("the covariance is not symmetric")
        if np.linalg.eigvalsh(correlation).min() < -NEGATIVE * m:
            raise ValueError("the covariance has a negative variance in some direction")

    @classmethod
    def of_sensors(cls, names: Sequence[str], cov: FloatArray) -> "Calibration":
        """Take what flies out of a rig calibration's parameters.

        The rig's own parameters are left out, and so is what changes with temperature: the flight
        is taken to be at the reference temperature. A jump of a constant error is over by then: its
        size is part of the constant error. A drift of it, which has zero mean over the run, has
        reached half its size at the end where it is even, and less where it fades: half of it is
        part of the constant error.
        """
        cov = np.asarray(cov, dtype=float)
        if cov.shape != (len(names), len(names)):
            raise ValueError(f"the covariance has shape {cov.shape}, expected {(len(names),) * 2}")
        known = rig_library().parameters
        ones = [known.get(name) for name in names]
        places = {(one.group, one.axis): k for k, one in enumerate(ones) if one}
        into = np.eye(len(names))
        for k, one in enumerate(ones):
            if one and one.group in REACHED:
                into[places[one.family, one.axis], k] = REACHED[one.group]
        cov = into @ cov @ into.T
        keep = [k for k, one in enumerate(ones) if one is None or _in_flight(one)]
        return cls(names=tuple(names[k] for k in keep), cov=cov[np.ix_(keep, keep)])

    @property
    def groups(self) -> tuple[str, ...]:
        """The group of each parameter."""
        return tuple(rig_library().parameter(name).family for name in self.names)

    @property
    def root(self) -> FloatArray:
        """A matrix L with L Lᵀ the covariance, shape (m, m), even of a singular one."""
        sigma = np.sqrt(np.diag(self.cov))
        scale = np.where(sigma > 0.0, sigma, 1.0)
        value, vector = np.linalg.eigh(self.cov / np.outer(scale, scale))
        return scale[:, None] * vector * np.sqrt(np.maximum(value, 0.0))


def sensor_errors(parameters: Mapping[str, float], motion: Motion) -> FloatArray:
    """Return measured less true of gyros and accelerometers, SI, shape (n, 6)."""
    sensors = _with(parameters)
    return sensors.errors(motion, as_vector(sensors, parameters))


def error_columns(names: Sequence[str], motion: Motion) -> FloatArray:
    """Return the derivative of the six sensors' errors by parameters, SI, shape (n, 6, m)."""
    sensors = _with(names)
    columns = sensors.columns(motion, sensors.start_values())
    out = np.zeros((len(motion), 6, len(names)))
    for k, name in enumerate(names):
        at = sensors.names.index(name)
        out[:, sensors.owner[at], k] = columns[:, at]
    return out


def at_rest(rate: FloatArray, force: FloatArray) -> Motion:
    """Return the motion of a body at rest: its rate with the earth and the force, each (3,)."""
    one = np.ones(1)
    return Motion(time_s=one, step_s=one, w=rate[None], f=force[None], dw=np.zeros((1, 3)))
