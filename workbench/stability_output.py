"""Run-to-run stability told: as the JSON of `accelbench stability`, and in words."""

from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import RenderableType

from errormodel.variance import Component, VarianceFit
from thermo.residuals import DIRECTIONS
from thermo.stability import DEFINITION, AccelerometerStability, Stability
from thermo.stability_coefficients import CoefficientStability
from thermo.stability_components import FACTORS
from thermo.stability_curves import Distance
from thermo.stability_limits import Criterion, Interval
from workbench.console import number, table
from workbench.fit_output import value_and_sigma

TOLD = ("k0", "k1")
FEW_RUNS = 4  # a trend of 3 σ is found in a third of cases or fewer
SUSPECT = 0.05


def stability_document(result: Stability) -> dict[str, Any]:
    """Return what `stability --json` writes."""
    return {
        "definition": definition(result),
        "at_c": list(result.at_c),
        "runs": list(result.order),
        "runs_ordered_by": "run_start_utc" if result.by_time else "their place in the files",
        "between": [
            {
                "after": i.after,
                "before": i.before,
                "power_off": i.power_off,
                "rest_h": i.rest_h,
                "remount": i.remount,
                "note": i.note,
            }
            for i in result.intervals
        ],
        "accelerometers": [_accelerometer(a) for a in result.accelerometers],
        "common_events": [
            {
                "run": e.run_id,
                "coefficient": e.coefficient,
                "unit": e.unit,
                "shift": e.shift,
                "sigma": e.sigma,
                "p_value": e.p_value,
                "serials": list(e.shifts),
            }
            for e in result.events
        ],
        "left_out": [
            {"serial": o.serial, "run": o.run_id, "reason": o.reason} for o in result.left_out
        ],
        "variance_components": _components(result.components),
    }


def definition(result: Stability) -> str:
    """Say what repeatability means in this report: definition, runs, statistic, temperature."""
    temperatures = " and ".join(f"{t:g} °C" for t in result.at_c)
    return (
        f"{DEFINITION} Here: {len(result.order)} runs; 1 σ between runs with the estimation's own "
        f"variance taken out, and max − min of the runs; reference temperature {temperatures}. "
        + " ".join(f"{text}." for text in between_sentences(result.intervals))
    )


def between_sentences(intervals: Sequence[Interval]) -> list[str]:
    """Say what happened between the runs; what was the same is said once."""
    same: dict[str, list[str]] = {}
    for i in intervals:
        same.setdefault(i.facts, []).append(f"{i.after} and {i.before}")
    if len(same) == 1 and len(intervals) > 1:
        return [f"Between all runs: {next(iter(same))}"]
    return [f"Between {', '.join(pairs)}: {facts}" for facts, pairs in same.items()]


def _accelerometer(one: AccelerometerStability) -> dict[str, Any]:
    noise = one.runs.noise.noise
    return {
        "serial": one.serial,
        "n_runs": len(one.runs.runs),
        "coefficients": {c.name: _coefficient(c) for c in one.coefficients},
        "curve_distance_ug": _distance(one.k0_distance),
        "curve_distance_k1_ppm": _distance(one.k1_distance),
        "curves": [
            {
                "direction": DIRECTIONS[s.direction],
                "runs": list(s.run_ids),
                "temp_c": s.temp_c.tolist(),
                "k0_ug": s.k0_ug.tolist(),
                "k1_ppm": s.k1_ppm.tolist() if one.k1_distance else None,
            }
            for s in one.curves
        ],
        "spread_ug": one.shape.spread_ug if one.shape else None,
        "spread_ci95_ug": list(one.shape.spread_ci95_ug) if one.shape else None,
        "bend_ug": one.shape.bend_ug if one.shape else None,
        "bend_ci95_ug": list(one.shape.bend_ci95_ug) if one.shape else None,
        "rank": one.rank,
        "grade": one.grade,
        "grade_best": one.grade_best,
        "verdict": one.verdict,
        "criteria": [
            {
                "name": c.name,
                "value": c.value,
                "bounds": list(c.bounds),
                "limit": c.limit,
                "unit": c.unit,
                "verdict": c.verdict,
            }
            for c in one.criteria
        ],
        "trends": list(one.trends),
        "patterns": [
            {
                "coefficient": p.coefficient,
                "kind": p.kind,
                "run": p.run_id,
                "size": p.size,
                "unit": p.unit,
                "p_value": p.p_value,
            }
            for p in one.patterns
        ],
        "loops": None
        if one.loops is None
        else {
            "runs": list(one.loops.run_ids),
            "heating_minus_cooling_ug": one.loops.values.tolist(),
            "sigma_ug": one.loops.sigmas.tolist(),
            "p_value": one.loops.p_value,
            "differ": one.loops_differ,
            "odd": list(one.loops.odd),
        },
        "allan": {"tau_s": one.allan.tau_s.tolist(), "ug": one.allan.deviation.tolist()},
        "noise": {
            "white_ug": 1e6 * noise.white,
            "drift_ug": 1e6 * noise.drift,
            "drift_tau_s": noise.drift_tau_s,
            "ratio_by_run": dict(one.runs.noise_ratios),
        },
        "notes": list(one.notes),
    }


def _coefficient(one: CoefficientStability) -> dict[str, Any]:
    scatter, chart = one.scatter, one.chart
    return {
        "mean": scatter.mean,
        "mean_sigma": scatter.mean_sigma,
        "sigma_run": scatter.sigma_run,
        "ci95": list(scatter.ci95),
        "max_minus_min": scatter.max_minus_min,
        "max_minus_min_ci95": list(scatter.max_minus_min_ci95),
        "unit": one.unit,
        "trend_p": scatter.trend_p,
        "trend_per_run": one.trend_per_run,
        "trend_per_day": one.trend_per_day,
        "sigma_observed": scatter.sigma_runs_observed,
        "sigma_estimation": scatter.sigma_estimation,
        "by_run": [
            {"run": r, "value": v, "sigma": s}
            for r, v, s in zip(one.run_ids, one.values.tolist(), one.sigmas.tolist(), strict=True)
        ],
        "chart": {
            "centre": chart.centre,
            "limits": list(chart.limits) if chart.limits else None,
            "moving_ranges": chart.ranges.tolist(),
            "range_limit": chart.range_limit,
            "outside": [one.run_ids[k] for k in chart.outside] if chart.limits else None,
            "false_alarm": chart.false_alarm,
        },
    }


def _distance(one: Distance | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "rms": one.rms,
        "max": one.largest,
        "rms_ci95": list(one.rms_bounds(0.05)),
        "max_ci95": list(one.largest_bounds(0.05)),
        "max_at": None if one.largest_at is None else _place(one.largest_at),
    }


def _place(at: tuple[str, str, float, int]) -> dict[str, Any]:
    return {"runs": [at[0], at[1]], "temp_c": at[2], "direction": DIRECTIONS[at[3]]}


def _components(found: VarianceFit | None) -> dict[str, Any]:
    by_name = {c.name: c for c in found.components} if found else {}
    return {
        name: {
            "sigma_ug": by_name[name].sigma,
            "ci95": list(by_name[name].ci95),
            "levels": by_name[name].levels,
            "dof": by_name[name].dof,
        }
        if name in by_name
        else None
        for name in FACTORS
    }


def stability_text(result: Stability) -> Iterator[RenderableType]:
    """Tell it in words and tables."""
    yield from headline(result)
    yield ""
    names = ("K0 1σ µg", "limits", "K0 max−min µg", "K1 1σ ppm", "curves rms µg", "max µg")
    made = table("rank", "serial", "verdict", "grade", "runs", *names, right=("rank", *names))
    for one in sorted(result.accelerometers, key=lambda a: a.rank):
        made.add_row(*summary_row(one))
    yield made
    yield LIMITS_TEXT
    for one in result.accelerometers:
        yield ""
        yield from _one_text(one)
    yield ""
    yield from component_lines(result.components)
    yield ""
    yield definition(result)


def headline(result: Stability) -> Iterator[str]:
    """Say how many pass, and what is wrong with those that do not."""
    verdicts = [a.verdict for a in result.accelerometers]
    counts = [f"{verdicts.count(v)} {v}" for v in ("pass", "fail", "undecided") if v in verdicts]
    said = f": {', '.join(counts)}" if counts else "; no limits given"
    yield f"{len(verdicts)} accelerometer(s), {len(result.order)} runs{said}"
    for event in result.events:
        yield f"  {event.sentence}"
    for out in result.left_out:
        yield f"  {out.sentence}"
    for one in result.accelerometers:
        for c in one.criteria:
            if c.verdict != "pass":
                yield f"  {one.serial}: {criterion_text(c)}"
        for line in movements(one):
            yield f"  {one.serial}: {line}"


def movements(one: AccelerometerStability) -> Iterator[str]:
    """Say what an accelerometer does over the runs beyond chance."""
    for c in one.coefficients:
        if c.name in one.trends:
            yield f"{trend_text(c)} (p = {number(c.scatter.trend_p, 1)})"
    for p in one.patterns:
        yield p.sentence
    if one.loops is not None and one.loops_differ:
        yield one.loops.sentence


def trend_text(c: CoefficientStability) -> str:
    """Say how a coefficient moves with time, or from run to run."""
    per = (
        f"{number(c.trend_per_run, 3)} {c.unit} a run"
        if c.trend_per_day is None
        else f"{number(c.trend_per_day, 3)} {c.unit} a day"
    )
    return f"{c.name} drifts by {per}, {number(c.trend_in_all, 3)} {c.unit} from first to last run"


def criterion_text(c: Criterion) -> str:
    """Say a criterion in a line."""
    lo, hi = c.bounds
    words = {"pass": "is kept", "fail": "is exceeded", "undecided": "cannot be decided"}
    return (
        f"{c.name} {number(c.value, 3)} {c.unit} ({number(lo, 3)} to {number(hi, 3)}): "
        f"limit {number(c.limit)} {words[c.verdict]}"
    )


def summary_row(one: AccelerometerStability) -> list[str]:
    """Return the cells of an accelerometer in the table of the batch."""
    k0, k1 = (one.coefficient(n) for n in TOLD)
    apart = one.k0_distance
    return [
        str(one.rank),
        one.serial,
        one.verdict,
        grade_text(one),
        str(len(one.runs.runs)),
        sigma_text(k0.scatter.sigma_run, sigma_limits(one, k0)) if k0 else "–",
        limits_text(sigma_limits(one, k0)) if k0 else "–",
        number(k0.scatter.max_minus_min, 3) if k0 else "–",
        sigma_text(k1.scatter.sigma_run, sigma_limits(one, k1)) if k1 else "–",
        number(apart.rms if apart else None, 3),
        number(apart.largest if apart else None, 3),
    ]


def grade_text(one: AccelerometerStability) -> str:
    """Write the grade that is shown to be kept, and the better one that the runs do not exclude."""
    if one.grade == one.grade_best:
        return one.grade or "–"
    return f"{one.grade or 'none'} ({one.grade_best}?)"


def sigma_limits(one: AccelerometerStability, c: CoefficientStability) -> tuple[float, float]:
    """Return the limits of a sigma between runs: those of the verdict where there is one."""
    return _shown(one, f"{c.name} sigma_run", c.scatter.ci95)


def _shown(
    one: AccelerometerStability, criterion: str, usual: tuple[float, float]
) -> tuple[float, float]:
    return next((c.bounds for c in one.criteria if c.name == criterion), usual)


def sigma_text(sigma: float, limits: tuple[float, float]) -> str:
    """Write a sigma; one that the runs do not show is written as its upper limit."""
    return f"< {number(limits[1], 3)}" if sigma == 0.0 else number(sigma, 3)


def limits_text(pair: Sequence[float]) -> str:
    """Write two limits."""
    return f"{number(pair[0], 3)} to {number(pair[1], 3)}"


COLUMNS = (
    "coefficient", "unit", "mean", "1σ between runs", "limits", "max−min", "limits",
    "estimation 1σ", "trend p",
)  # fmt: skip


LIMITS_TEXT = (
    "limits: 95 %, or where an acceptance limit is set those of the verdict (all limits of an "
    "accelerometer together wrong in 5 % of cases)"
)


def coefficient_row(one: AccelerometerStability, c: CoefficientStability) -> list[str]:
    """Return the cells of a coefficient of an accelerometer; headed by `COLUMNS`."""
    s = c.scatter
    limits = sigma_limits(one, c)
    return [
        c.name,
        f"{c.unit} from nominal" if c.name.partition("_at_")[0] == "k1" else c.unit,
        value_and_sigma(s.mean, s.mean_sigma),
        sigma_text(s.sigma_run, limits),
        limits_text(limits),
        number(s.max_minus_min, 3),
        limits_text(_shown(one, f"{c.name} max_minus_min", s.max_minus_min_ci95)),
        number(s.sigma_estimation, 3),
        number(s.trend_p, 2),
    ]


def _one_text(one: AccelerometerStability) -> Iterator[RenderableType]:
    yield f"{one.serial}: {len(one.runs.runs)} runs, {one.verdict}"
    made = table(*COLUMNS, right=COLUMNS[2:])
    for c in one.coefficients:
        made.add_row(*coefficient_row(one, c))
    yield made
    for line in sentences(one):
        yield f"  {line}"


def sentences(one: AccelerometerStability) -> Iterator[str]:
    """Tell what the table of coefficients does not hold, a sentence a line."""
    for c in one.criteria:
        yield criterion_text(c)
    if one.k0_distance:
        yield _distance_text("K0", one.k0_distance, "µg")
    if one.k1_distance:
        yield _distance_text("K1", one.k1_distance, "ppm")
    if one.shape:
        yield (
            "K0 over temperature: runs and directions spread "
            f"{sigma_text(one.shape.spread_ug, one.shape.spread_ci95_ug)} µg rms about their mean "
            f"({limits_text(one.shape.spread_ci95_ug)}), which bends "
            f"{number(one.shape.bend_ug, 3)} µg rms from a line"
        )
    yield from movements(one)
    yield from _no_movement(one)
    yield _chart_text(one)
    yield from one.notes


def _no_movement(one: AccelerometerStability) -> Iterator[str]:
    """Say what cannot be said of a trend: so few runs hardly show one."""
    runs = len(one.runs.runs)
    if one.trends:
        return
    if runs > FEW_RUNS:
        yield "no coefficient is shown to move with the runs"
        return
    looks = [
        f"{trend_text(c)} (p = {number(c.scatter.trend_p, 1)})"
        for c in one.coefficients
        if c.scatter.trend_p is not None and c.scatter.trend_p < SUSPECT
    ]
    said = f", but {'; '.join(looks)}" if looks else ""
    yield f"{runs} runs cannot tell a trend from scatter{said}"


def _distance_text(name: str, one: Distance, unit: str) -> str:
    lo, hi = one.largest_bounds(0.05)
    text = (
        f"{name} curves of the runs lie {number(one.rms, 3)} {unit} rms apart, "
        f"{number(one.largest, 3)} {unit} at most ({number(lo, 3)} to {number(hi, 3)})"
    )
    if one.largest_at:
        low, high, temp_c, direction = one.largest_at
        text += f", runs {low} and {high} at {temp_c:.0f} °C, {DIRECTIONS[direction]}"
    return text


def _chart_text(one: AccelerometerStability) -> str:
    charted = [c for c in one.coefficients if c.name in TOLD and c.chart.limits]
    if not charted:
        return "control charts: values only, limits need 8 runs"
    said = [
        f"{c.name}: {', '.join(c.run_ids[k] for k in c.chart.outside) or 'no run'} outside"
        for c in charted
    ]
    alarm = charted[0].chart.false_alarm or 0.0
    return f"control charts: {'; '.join(said)} (each chart has {alarm:.0%} chance of a false alarm)"


def component_lines(found: VarianceFit | None) -> Iterator[str]:
    """Tell the variance components."""
    if found is None:
        yield "variance components: these runs cannot tell any apart"
        return
    yield "variance components of the error, 1 σ in µg (95 % limits):"
    for c in found.components:
        yield f"  {component_text(c)}"


def component_text(c: Component) -> str:
    """Say a component in a line."""
    return (
        f"{c.name} {number(c.sigma, 3)} ({limits_text(c.ci95)}), {c.dof} degree(s) of freedom: "
        f"{FACTORS[c.name]}"
    )
