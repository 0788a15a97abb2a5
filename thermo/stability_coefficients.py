"""The coefficients of an accelerometer over its runs, and the limits that they are held against."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.chart import Chart, individuals_chart
from errormodel.scatter import Scatter, range_bounds, scatter_between, sigma_bounds
from thermo.stability_curves import Distance
from thermo.stability_limits import FALSE_ALARM, Criterion, LimitsFile
from thermo.stability_runs import RunByRun

FIRST = ("k0", "k1")  # told before all others
CURVE = "curve distance"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CoefficientStability:
    """One coefficient over the runs.

    Attributes
    ----------
    name, unit : str
    run_ids : tuple of str
        The runs that can give it, in order.
    values, sigmas : ndarray, shape (n,)
    scatter : Scatter
    chart : Chart
        Of the values; it has limits from 8 runs on.
    """

    name: str
    unit: str
    run_ids: tuple[str, ...]
    values: FloatArray
    sigmas: FloatArray
    scatter: Scatter
    chart: Chart

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), sigmas=readonly(self.sigmas))


def _stability(
    name: str, unit: str, run_ids: Sequence[str], pairs: Sequence[tuple[float, float]]
) -> CoefficientStability:
    values, sigmas = (np.array([p[k] for p in pairs]) for k in (0, 1))
    return CoefficientStability(
        name=name,
        unit=unit,
        run_ids=tuple(run_ids),
        values=values,
        sigmas=sigmas,
        scatter=scatter_between(values, sigmas),
        chart=individuals_chart(values),
    )


def model_coefficients(one: RunByRun) -> tuple[CoefficientStability, ...]:
    """Return the model's coefficients that two runs or more can give, K0 and K1 first."""
    units = {c.name: c.unit for c in one.joint.fit.model.coefficients}
    units |= {"k1": "ppm"} if "k1" in units else {}
    found: list[CoefficientStability] = []
    for name, unit in units.items():
        having = [r for r in one.runs if name in r.fit.names]
        if len(having) >= 2:
            pairs = [r.coefficient(name) for r in having]
            found.append(_stability(name, unit, [r.run_id for r in having], pairs))
    return tuple(sorted(found, key=lambda c: (c.name not in FIRST, c.name != "k0")))


def coefficients_at(
    one: RunByRun, temperatures: Sequence[float]
) -> tuple[CoefficientStability, ...]:
    """Return K0 and K1 at temperatures, °C, named as "k0_at_60c"."""
    found: list[CoefficientStability] = []
    for temp_c in temperatures:
        x = np.array([temp_c - one.joint.t_ref_c])
        for family, unit in (("k0", "µg"), ("k1", "ppm")):
            having = [r for r in one.runs if family in r.fit.names]
            pairs: list[tuple[float, float]] = []
            for r in having:
                value, gradient = r.curve(family, x)
                pairs.append((float(value[0]), _sigma(gradient[0], r.fit.cov)))
            if len(having) >= 2:
                name = f"{family}_at_{temp_c:g}c"
                found.append(_stability(name, unit, [r.run_id for r in having], pairs))
    return tuple(found)


def _sigma(gradient: FloatArray, cov: FloatArray) -> float:
    return float(np.sqrt(max(gradient @ cov @ gradient, 0.0)))


def criteria_of(
    coefficients: Sequence[CoefficientStability], apart: Distance | None, limits: LimitsFile
) -> tuple[Criterion, ...]:
    """Hold every limit against its bounds; together they are wrong in 5 % of cases."""
    asked = _asked(limits)
    alpha = FALSE_ALARM / max(len(asked), 1)
    by_name = {c.name: c for c in coefficients}
    found: list[Criterion] = []
    for name, measure, limit in asked:
        if name in by_name:
            found.append(_of_coefficient(by_name[name], measure, limit, alpha))
        elif name == CURVE and apart is not None:
            rms = measure == "rms"
            found.append(
                Criterion(
                    name=f"{name} {measure}",
                    value=apart.rms if rms else apart.largest,
                    bounds=apart.rms_bounds(alpha) if rms else apart.largest_bounds(alpha),
                    limit=limit,
                    unit="µg",
                )
            )
    return tuple(found)


def _asked(limits: LimitsFile) -> list[tuple[str, str, float]]:
    asked = [
        (name, measure, limit)
        for name, of_one in limits.limits.items()
        for measure, limit in of_one.model_dump(exclude_none=True).items()
    ]
    return asked + [(CURVE, m, x) for m, x in limits.curve_ug.model_dump(exclude_none=True).items()]


def _of_coefficient(
    one: CoefficientStability, measure: str, limit: float, alpha: float
) -> Criterion:
    scatter = one.scatter
    if measure == "sigma_run":
        value, bounds = scatter.sigma_run, sigma_bounds(one.values, one.sigmas, alpha)
    else:
        value, bounds = scatter.max_minus_min, range_bounds(one.values, one.sigmas, alpha)
    return Criterion(
        name=f"{one.name} {measure}", value=value, bounds=bounds, limit=limit, unit=one.unit
    )
