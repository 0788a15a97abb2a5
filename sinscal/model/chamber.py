"""Rig calibration of a SINS whose accelerometers bring their chamber's models.

An accelerometer's channel is its chamber's model, unchanged, and what the SINS adds to it: how it
is mounted in the block, and where its mass stands. The chamber's coefficients are states of the rig
filter, with the chamber's full covariance as prior: rig and chamber correct each other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.errors import InputError
from errormodel.model import ErrorModel
from errormodel.terms import in_unit, on_axis
from sinscal.library import rig_library
from sinscal.library.groups import CHANNELS
from sinscal.model.priors import PriorFile, RigPrior, make_prior
from sinscal.model.sensors import CHAMBER_SIGNALS, SensorModel, sensor_model
from sinscal.recording.run import AXES, RigRun

# The mounting in the block says where the input axis points: the case's own angles go into it.
IN_THE_MOUNTING = ("delta_o", "delta_p")
# What the chamber's k0 and k1 stand for; the rest of the groups is the SINS's own.
CHAMBERS_OWN = ("accel_bias", "accel_scale", "accel_temperature_bias", "accel_temperature_scale")
# The accelerometers' k1 by name, and their k0 with the k1 of the same axis.
SCALES = tuple(f"k1_{a}" for a in AXES)
ZEROS = {f"k0_{a}": f"k1_{a}" for a in AXES}
AT_REFERENCE = {
    f"{name}_{a}": f"{error}_{a}"
    for name, error in (("k0", "accel_bias"), ("k1", "accel_scale"))
    for a in AXES
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChamberModel:
    """One accelerometer's model over temperature, as fitted in the chamber.

    Attributes
    ----------
    serial : str
    model : ErrorModel
        Counts in g at the input.
    values : ndarray, shape (p,)
        In the order of `model.names`, in the model's own units.
    cov : ndarray, shape (p, p)
    gravity_m_s2 : float
        The g it counts in.
    t_ref_c : float
    valid_c : pair of float
        Range of temperature it was fitted over.
    """

    serial: str
    model: ErrorModel
    values: FloatArray
    cov: FloatArray
    gravity_m_s2: float
    t_ref_c: float
    valid_c: tuple[float, float]

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), cov=readonly(self.cov))

    def without_mounting(self) -> "ChamberModel":
        """Return the model without the angles of the case: in the SINS they are its mounting."""
        kept = self.model.without(*IN_THE_MOUNTING)
        at = [self.model.names.index(n) for n in kept.names]
        return ChamberModel(
            serial=self.serial,
            model=kept,
            values=self.values[at],
            cov=self.cov[np.ix_(at, at)],
            gravity_m_s2=self.gravity_m_s2,
            t_ref_c=self.t_ref_c,
            valid_c=self.valid_c,
        )


def combined_sensors(
    chambers: Sequence[ChamberModel],
    groups: Sequence[str],
    *,
    twice: Sequence[str] = (),
) -> SensorModel:
    """Return the sensors of a SINS with its accelerometers' chamber models.

    Parameters
    ----------
    chambers : sequence of three ChamberModel
        Of the accelerometers x, y, z.
    groups : sequence of str
        What the SINS adds (groups of `sinscal.library`); what stands for bias, scale factor and
        their temperature in an accelerometer is the chamber's and left out.
    twice : sequence of str
        Of these the groups that stay all the same: errors that are left of a chamber's model
        which is held.

    Raises
    ------
    InputError
        If the models do not share their g and reference temperature, or one has a term whose
        signals a rig run does not give.
    """
    _check(chambers)
    first = chambers[0]
    sensors = sensor_model(groups, t_ref_c=first.t_ref_c, gravity_m_s2=first.gravity_m_s2)
    more = [g for g in groups if g not in CHAMBERS_OWN or g in twice]
    for axis, chamber in enumerate(chambers):
        own = tuple(on_axis(t, AXES[axis]) for t in chamber.without_mounting().model.terms)
        added = (
            in_unit(t, chamber.gravity_m_s2)
            for t in rig_library().terms_of(CHANNELS[3 + axis], more)
        )
        model = ErrorModel((*own, *added), chamber.model.base)
        sensors = sensors.with_channel(axis, model, chamber.gravity_m_s2)
    return sensors


def _check(chambers: Sequence[ChamberModel]) -> None:
    if len(chambers) != 3:
        raise InputError("the chamber models", "", f"{len(chambers)} given, expected three: x y z")
    for chamber in chambers:
        for one in chamber.model.terms:
            if missing := sorted(one.needs - CHAMBER_SIGNALS):
                problem = f"needs {', '.join(missing)}, which a run on a rig does not have"
                raise InputError(f"serial {chamber.serial}", one.name, problem)
    for one in chambers[1:]:
        for name in ("gravity_m_s2", "t_ref_c"):
            if getattr(one, name) != getattr(chambers[0], name):
                raise InputError(
                    f"serial {one.serial}", name,
                    f"{getattr(one, name):g}; expected that of {chambers[0].serial}, "
                    f"{getattr(chambers[0], name):g}",
                )  # fmt: skip


def combined_prior(
    sensors: SensorModel,
    chambers: Sequence[ChamberModel],
    *,
    file: PriorFile | None = None,
    turn_on: Mapping[str, float] | None = None,
) -> RigPrior:
    """Return the prior: the chamber's for its coefficients, the rig's for the rest.

    Parameters
    ----------
    sensors : SensorModel
        From `combined_sensors`.
    chambers : sequence of three ChamberModel
    file : PriorFile, optional
        The rig's priors.
    turn_on : mapping of str to float, optional
        Sigma by which a coefficient may have changed since the chamber, in the chamber model's own
        unit (`k0` in g, `k1` relative); added to the chamber's covariance.
    """
    prior = make_prior(sensors, file, others=chamber_names(sensors, chambers))
    values, cov = prior.values.copy(), prior.cov.copy()
    for axis, given in enumerate(chambers):
        chamber = given.without_mounting()
        at = [sensors.names.index(f"{n}_{AXES[axis]}") for n in chamber.model.names]
        values[at] = chamber.values
        extra = [(turn_on or {}).get(n, 0.0) ** 2 for n in chamber.model.names]
        cov[np.ix_(at, at)] = chamber.cov + np.diag(extra)
    return RigPrior(
        values=values,
        cov=cov,
        mount_sigma_rad=prior.mount_sigma_rad,
        remount_sigma_rad=prior.remount_sigma_rad,
    )


def chamber_names(sensors: SensorModel, chambers: Sequence[ChamberModel]) -> tuple[str, ...]:
    """Return the names of the chamber's coefficients among the unknowns, in their order."""
    own = {
        f"{n}_{AXES[axis]}"
        for axis, c in enumerate(chambers)
        for n in c.without_mounting().model.names
    }
    return tuple(n for n in sensors.names if n in own)


def reference_name(name: str) -> str:
    """Return an unknown's name in a calibration at the reference temperature: see `at_reference`.

    It is another one for an accelerometer's k0 and k1 alone.
    """
    return AT_REFERENCE.get(name, name)


def at_reference(
    names: Sequence[str], values: FloatArray, cov: FloatArray, gravity_m_s2: float
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Return a calibration at the reference temperature, in the rig's own names.

    With f′ = g·k1·(k0 + f/g + …) an accelerometer's scale error is k1 − 1 and its zero error
    g·k1·k0. All else is passed on as it is.

    Parameters
    ----------
    names, values, cov
        Of a combined calibration.
    gravity_m_s2 : float
        The g of the chamber models.

    Returns
    -------
    names, values, cov
    """
    out, jacobian = values.copy(), np.eye(len(names))
    index = {n: i for i, n in enumerate(names)}
    for i, name in enumerate(names):
        if name in SCALES:
            out[i] = values[i] - 1.0
        elif name in ZEROS:
            j = index.get(ZEROS[name])
            k1 = 1.0 if j is None else values[j]
            out[i] = gravity_m_s2 * k1 * values[i]
            jacobian[i, i] = gravity_m_s2 * k1
            if j is not None:
                jacobian[i, j] = gravity_m_s2 * values[i]
    return tuple(map(reference_name, names)), out, jacobian @ cov @ jacobian.T


def from_reference(
    names: Sequence[str], at_ref: Mapping[str, float], gravity_m_s2: float
) -> FloatArray:
    """Return the unknowns named from their values at the reference temperature.

    The inverse of `at_reference`, for values.
    """
    out = np.array([at_ref[reference_name(n)] for n in names])
    index = {n: i for i, n in enumerate(names)}
    for name, i in index.items():
        if name in SCALES:
            out[i] += 1.0
        elif name in ZEROS:
            out[i] /= gravity_m_s2 * (1.0 + at_ref.get(reference_name(ZEROS[name]), 0.0))
    return out


def within_range(run: RigRun, valid_c: Sequence[tuple[float, float]]) -> RigRun:
    """Return a run with temperatures no further than the accelerometers' models are valid.

    Parameters
    ----------
    run : RigRun
        With temperatures.
    valid_c : sequence of three pairs of float
        Of the accelerometers x, y, z.

    Returns
    -------
    RigRun
        With a warning for each accelerometer that was outside.

    Raises
    ------
    InputError
        If the run has no temperatures.
    """
    if run.temp_c is None:
        raise InputError(run.source, "temp_c", "missing; the accelerometers' models need it")
    low, high = np.array(valid_c).T
    inside = np.clip(run.temp_c, low, high)
    beyond = np.max(np.abs(np.asarray(run.temp_c) - inside), axis=0).tolist()
    told = [
        f"outside_range: accelerometer {axis}'s temperature is up to {far:.1f} °C outside the "
        f"range of its model, {lo:.0f} to {hi:.0f} °C; the end of the range was used"
        for axis, far, (lo, hi) in zip(AXES, beyond, valid_c, strict=True)
        if far > 0.0
    ]
    return replace(run, temp_c=inside, warnings=(*run.warnings, *told))
