"""Rig calibration of a SINS whose accelerometers bring their chamber's models.

An accelerometer's channel is its chamber's model, unchanged, and what the SINS adds to it: how it
is mounted in the block, and where its mass stands. The chamber's coefficients are states of the rig
filter, with the chamber's full covariance as prior: rig and chamber correct each other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.errors import InputError
from errormodel.model import ErrorModel
from errormodel.terms import in_unit, renamed
from sinscal.priors import PriorFile, RigPrior, make_prior
from sinscal.run import AXES
from sinscal.sensors import SensorModel, sensor_model
from sinscal.terms import CHANNELS, terms_of

# The mounting in the block says where the input axis points: the case's own angles go into it.
IN_THE_MOUNTING = ("delta_o", "delta_p")
# What the chamber's k0 and k1 stand for; the rest of the groups is the SINS's own.
CHAMBERS_OWN = ("accel_bias", "accel_scale", "accel_temperature_bias", "accel_temperature_scale")


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


def combined_sensors(chambers: Sequence[ChamberModel], groups: Sequence[str]) -> SensorModel:
    """Return the sensors of a SINS with its accelerometers' chamber models.

    Parameters
    ----------
    chambers : sequence of three ChamberModel
        Of the accelerometers x, y, z.
    groups : sequence of str
        What the SINS adds (`sinscal.terms.GROUPS`); what stands for bias, scale factor and their
        temperature in an accelerometer is the chamber's and left out.

    Raises
    ------
    InputError
        If the models do not share their g and reference temperature.
    """
    _check(chambers)
    first = chambers[0]
    sensors = sensor_model(groups, t_ref_c=first.t_ref_c, gravity_m_s2=first.gravity_m_s2)
    more = [g for g in groups if g not in CHAMBERS_OWN]
    for axis, chamber in enumerate(chambers):
        own = tuple(renamed(t, f"_{AXES[axis]}") for t in chamber.without_mounting().model.terms)
        added = (in_unit(t, chamber.gravity_m_s2) for t in terms_of(CHANNELS[3 + axis], more))
        model = ErrorModel((*own, *added), chamber.model.base)
        sensors = sensors.with_channel(axis, model, chamber.gravity_m_s2)
    return sensors


def _check(chambers: Sequence[ChamberModel]) -> None:
    if len(chambers) != 3:
        raise InputError("the chamber models", "", f"{len(chambers)} given, expected three: x y z")
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
    prior = make_prior(sensors, file)
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
    out_names: list[str] = []
    out_values: list[float] = []
    rows: list[FloatArray] = []
    unit = np.eye(len(names))
    index = {n: i for i, n in enumerate(names)}
    for name in names:
        stem, _, axis = name.rpartition("_")
        i = index[name]
        if stem == "k1":
            out_names.append(f"accel_scale_{axis}")
            out_values.append(values[i] - 1.0)
            rows.append(unit[i])
        elif stem == "k0":
            k1 = values[index[f"k1_{axis}"]] if f"k1_{axis}" in index else 1.0
            out_names.append(f"accel_bias_{axis}")
            out_values.append(gravity_m_s2 * k1 * values[i])
            row = gravity_m_s2 * k1 * unit[i]
            if f"k1_{axis}" in index:
                row = row + gravity_m_s2 * values[i] * unit[index[f"k1_{axis}"]]
            rows.append(row)
        else:
            out_names.append(name)
            out_values.append(values[i])
            rows.append(unit[i])
    jacobian = np.array(rows)
    return tuple(out_names), np.array(out_values), jacobian @ cov @ jacobian.T
