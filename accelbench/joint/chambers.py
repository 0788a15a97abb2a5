"""Accelerometers of the chamber as the rig takes them: fitted ones, and emulated ones."""

import click
import numpy as np

from errormodel.errors import InputError
from errormodel.model import ErrorModel
from sinscal.frames.earth import STANDARD_G
from sinscal.model.chamber import ChamberModel
from thermo.compensation.model_file import AccelerometerModel, reporting_factors
from thermo.twin.accelerometer import T_REF_C, emulated_accelerometer
from thermo.uncertainty.order_choice import with_next_orders


def three_serials(names: str) -> list[str]:
    """Return the serial numbers of x, y, z out of a list with commas.

    Raises
    ------
    UsageError
        If they are not three different ones.
    """
    serials = [s.strip() for s in names.split(",")]
    if len(serials) != 3 or len(set(serials)) != 3:
        raise click.UsageError(
            f"--accelerometers: {len(serials)} serial numbers ({', '.join(serials)}), "
            "expected three different ones, of x, y, z"
        )
    return serials


def chamber_model(one: AccelerometerModel) -> ChamberModel:
    """Return a fitted model as the rig takes it: in the model's own units.

    What belonged to the fitted runs or moments alone is left out: on the rig it is not. The next
    orders of bias and scale factor come in at zero, with what they may do unseen; what the file's
    covariance counts of it is not counted twice.

    Raises
    ------
    InputError
        If the accelerometer was fitted without known inputs.
    """
    if not one.has_input:
        raise InputError(
            f"serial {one.serial}", "has_input",
            "false: its scale factor is not known; expected a fit of readings at known positions",
        )  # fmt: skip
    whole = one.error_model()
    model = ErrorModel(tuple(t for t in whole.terms if t.predictive))
    at = [one.names.index(n) for n in model.names]
    factors = reporting_factors(model, one.nominal_scale)
    scale = np.array([factors[n] for n in model.names])
    own = one.values()
    model, values, cov = with_next_orders(
        model,
        np.array([own[n] for n in model.names]),
        np.array(one.covariance)[np.ix_(at, at)] / np.outer(scale, scale),
        (one.valid_c[0] - one.t_ref_c, one.valid_c[1] - one.t_ref_c),
        one.own_moves(),
    )
    return ChamberModel(
        serial=one.serial,
        model=model,
        values=values,
        cov=cov,
        gravity_m_s2=one.gravity_m_s2,
        t_ref_c=one.t_ref_c,
        valid_c=one.valid_c,
    )


def emulated_chamber(serial: str) -> ChamberModel:
    """Return what is true of an accelerometer of the emulated station: a model without error."""
    made = emulated_accelerometer(serial)
    p = len(made.model.names)
    return ChamberModel(
        serial=serial,
        model=made.model,
        values=np.array([made.values[n] for n in made.model.names]),
        cov=np.zeros((p, p)),
        gravity_m_s2=STANDARD_G,  # that of the emulated station
        t_ref_c=T_REF_C,
        valid_c=(-100.0, 200.0),
    )
