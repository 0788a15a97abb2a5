"""Run-to-run stability as the JSON document of `accelbench stability`."""

from collections.abc import Sequence
from typing import Any

from errormodel.statistics.variance import VarianceFit
from thermo.selection.residuals import DIRECTIONS
from thermo.stability.coefficients import CoefficientStability
from thermo.stability.components import FACTORS
from thermo.stability.curves import Distance
from thermo.stability.judge import DEFINITION, AccelerometerStability, Stability
from thermo.stability.limits import Interval


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
        f"variance taken out, and max − min of the runs; reference temperature {temperatures}; "
        "µg over the K1 of all runs of an accelerometer. "
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
    noise = one.runs.noise
    return {
        "serial": one.serial,
        "n_runs": len(one.runs.runs),
        "own_scale": one.runs.joint.own_scale,
        "scale": "fitted" if one.runs.scale_fitted else "nominal",
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
