"""The coefficients of an accelerometer over its runs, and the limits that they are held against."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.statistics.chart import Chart, individuals_chart
from errormodel.statistics.scatter import Scatter, range_bounds, scatter_between, sigma_bounds
from thermo.stability.curves import Distance
from thermo.stability.limits import FALSE_ALARM, Criterion, LimitsFile
from thermo.stability.runs import RunByRun, RunFit

FIRST = ("k0", "k1")  # told before all others
CURVE = "curve distance"
Days = Mapping[str, float]


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
    sigma_dof : float
        Degrees of freedom that the sigmas are known to.
    days : ndarray or None
        When the runs began, d from the first; None where that is not known. The trend is along it,
        else along the runs' places.
    from_nominal : bool
        Whether it is told as what differs from the nominal scale factor.
    """

    name: str
    unit: str
    run_ids: tuple[str, ...]
    values: FloatArray
    sigmas: FloatArray
    scatter: Scatter
    chart: Chart
    sigma_dof: float
    days: FloatArray | None
    from_nominal: bool = False

    @property
    def trend_per_day(self) -> float | None:
        """Slope of the trend in time; None where the starts are not known."""
        return None if self.days is None else self.scatter.trend_per_run

    @property
    def trend_per_run(self) -> float | None:
        """Slope of the trend from run to run; None with two runs."""
        if self.days is None or self.scatter.trend_per_run is None:
            return self.scatter.trend_per_run
        place = np.arange(self.values.size) - (self.values.size - 1) / 2.0
        return float(place @ self.values / (place @ place))

    @property
    def trend_in_all(self) -> float | None:
        """Change from the first run to the last along the trend; None with two runs."""
        slope = self.scatter.trend_per_run
        span = self.values.size - 1.0 if self.days is None else float(np.ptp(self.days))
        return None if slope is None else slope * span

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), sigmas=readonly(self.sigmas))


def _stability(
    name: str,
    unit: str,
    having: Sequence[RunFit],
    pairs: Sequence[tuple[float, float]],
    sigma_dof: float,
    days: Days,
    *,
    from_nominal: bool,
) -> CoefficientStability:
    values, sigmas = (np.array([p[k] for p in pairs]) for k in (0, 1))
    when = np.array([days[r.run_id] for r in having]) if days else None
    return CoefficientStability(
        name=name,
        unit=unit,
        run_ids=tuple(r.run_id for r in having),
        values=values,
        sigmas=sigmas,
        scatter=scatter_between(values, sigmas, order=when, sigma_dof=sigma_dof),
        chart=individuals_chart(values),
        sigma_dof=sigma_dof,
        days=when,
        from_nominal=from_nominal,
    )


def model_coefficients(one: RunByRun, days: Days) -> tuple[CoefficientStability, ...]:
    """Return the model's coefficients that two runs or more can give, K0 and K1 first.

    `days` says when runs began; empty where that is not known.
    """
    units = {c.name: c.unit for c in one.joint.fit.model.coefficients}
    units |= {"k1": "ppm"} if "k1" in units else {}
    found: list[CoefficientStability] = []
    for name, unit in units.items():
        having = [r for r in one.runs if name in r.fit.names]
        if len(having) >= 2:
            pairs = [r.coefficient(name) for r in having]
            dof = min(r.dof(name) for r in having)
            found.append(
                _stability(name, unit, having, pairs, dof, days, from_nominal=name == "k1")
            )
    return tuple(sorted(found, key=lambda c: (c.name not in FIRST, c.name != "k0")))


def coefficients_at(
    one: RunByRun, temperatures: Sequence[float], days: Days
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
                dof = min(r.dof(family) for r in having)
                k1 = family == "k1"
                found.append(_stability(name, unit, having, pairs, dof, days, from_nominal=k1))
    return tuple(found)


def _sigma(gradient: FloatArray, cov: FloatArray) -> float:
    return float(np.sqrt(max(gradient @ cov @ gradient, 0.0)))


def unjudged(
    coefficients: Sequence[CoefficientStability], apart: Distance | None, limits: LimitsFile
) -> tuple[str, ...]:
    """Return the limits that an accelerometer's runs give nothing to hold against."""
    known = [c.name for c in coefficients] + ([CURVE] if apart is not None else [])
    return tuple(dict.fromkeys(name for name, _, _ in _asked(limits) if name not in known))


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
        value, bounds = (
            scatter.sigma_run,
            sigma_bounds(one.values, one.sigmas, alpha, one.sigma_dof),
        )
    else:
        value, bounds = (
            scatter.max_minus_min,
            range_bounds(one.values, one.sigmas, alpha, one.sigma_dof),
        )
    return Criterion(
        name=f"{one.name} {measure}", value=value, bounds=bounds, limit=limit, unit=one.unit
    )
