"""Smallest size of each effect that the runs at hand can name."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from errormodel.discrepancy.foresight import NAMEABLE_D
from thermo.discrepancy.words import ParameterValue
from thermo.library import term

if TYPE_CHECKING:
    from thermo.discrepancy.find import Discrepancy


def smallest_nameable(d: "Discrepancy") -> Mapping[str, ParameterValue]:
    """Return the size at which each visible effect reaches a strength of seven.

    The size is the first coefficient of the effect, with its nonlinear parameters in the middle of
    their range; for an effect without a coefficient, the parameter itself.
    """
    made: dict[str, ParameterValue] = {}
    foresight = d.foresight
    for name, strength in zip(foresight.names, foresight.strength.tolist(), strict=True):
        if name in foresight.invisible:
            continue
        effect = next(e for e in d.source.effects if e.name == name)
        first = term(d.source.forms(effect)[0].terms[0])
        if name in foresight.least_theta:
            made[name] = ParameterValue(
                value=foresight.least_theta[name], sigma=0.0, unit=first.parameters[0].unit
            )
        elif strength > 0 and first.coefficients:
            unit = first.coefficients[0]
            value = NAMEABLE_D / strength * unit.per_unit * 1e-6
            made[name] = ParameterValue(value=value, sigma=0.0, unit=unit.unit)
    return made
