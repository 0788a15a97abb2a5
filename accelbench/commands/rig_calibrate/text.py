"""A rig calibration told: as the JSON of `accelbench rig calibrate`, and in words."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType

from accelbench.shell.console import number, table, value_and_sigma
from sinscal.judgement.result_file import ResultContent
from sinscal.library import rig_library
from sinscal.recording.run import AXES

WELL_PROTECTED = 2.0  # times the noise's share: below it no effect is worth telling
LEVELS = (
    "protection level: the largest error of the worst parameter of a group that a missing effect "
    "can cause in a run that passes (in 99 % of runs), plus three sigmas"
)
VOID = "because tests failed, the levels below are valid only after the cause is removed"
PASSED = "passed: the calibration is consistent with its sigmas"
SHOWN = 10  # refused measurements in words
FEW = 3  # pairs that correlate, warnings of one kind
TESTS = {
    "converged": "the iteration converged",
    "nis": "innovations agree with their sigmas",
    "white": "innovations are white",
    "no_slow_drift": "innovations show no slow drift",
    "within_bound": "errors with a bound instead of a sigma are within it",
    "held_out": "a cycle held out agrees with the others",
    "prior": "the errors are no larger than their priors",
    "complete": "the innovations show no missing effect",
    "no_contradiction": "no stated value contradicts the run",
}


def calibration_document(result: ResultContent) -> dict[str, Any]:
    """Return what `rig calibrate --json` writes: the result file's content."""
    return result.model_dump(mode="json")


def verdict(result: ResultContent) -> str:
    """Say in a line whether the calibration can be trusted."""
    tests: Mapping[str, bool | None] = result.consistency["tests"]
    failed = [TESTS[name] for name, ok in tests.items() if ok is False]
    if not failed and result.protection and (exceeded := result.protection["exceeded"]):
        return (
            f"failed: protection level above the limit: {', '.join(exceeded)}; all tests passed, "
            f"but they would not detect a missing effect of this size"
        )
    if not failed:
        rest = f" ({told})" if (told := not_made(result)) else ""
        return f"{PASSED}{rest}"
    missing = {"nis", "white", "held_out", "complete", "converged"} & {
        n for n, ok in tests.items() if ok is False
    }
    asks = "; `accelbench discrepancy rig` searches for the missing effect"
    hint = asks if missing and result.mode != "navigation" else ""
    return f"failed: not fulfilled: {'; '.join(failed)}{hint}"


def not_made(result: ResultContent) -> str:
    """Say which tests were not made; empty when all were."""
    left = [TESTS[n] for n, ok in result.consistency["tests"].items() if ok is None]
    return f"not tested: {'; '.join(left)}" if left else ""


def calibration_sentences(result: ResultContent, *, listed: bool = True) -> Iterator[str]:
    """Tell the verdict and what it rests on, a sentence a line.

    Parameters
    ----------
    result : ResultContent
    listed : bool
        Whether refused measurements are listed.
    """
    c = result.consistency
    yield verdict(result)
    lo, hi = c["nis_interval"]
    yield (
        f"NIS {c['nis_mean']:.3f} over {c['n']} innovations, expected {lo:.3f} to {hi:.3f} "
        f"(99.9 % of correct calibrations)"
    )
    channels = c["channels"].items()
    least = min(channels, key=lambda pair: min(pair[1]["white_p"], pair[1]["slow_drift_p"]))
    yield (
        f"whiteness of the innovations: the smallest p-value is {least[0]}'s, "
        f"{min(least[1]['white_p'], least[1]['slow_drift_p']):.2g}"
    )
    if bounded := c["bounded"]:
        yield (
            f"rows with a bound instead of a sigma: NIS {number(bounded['nis_mean'], 3)}, "
            f"at most {bounded['nis_interval'][1]:.3f} allowed"
        )
    for held in c["held_out"]:
        line = (
            f"cycle {held['cycle']} held out: including it changes the estimates by χ² "
            f"{held['shift_chi2']:.1f} with {held['dof']} degrees of freedom, "
            f"p {held['p_value']:.2g}"
        )
        if held["force_residual_before_m_s2"] is not None:
            line += (
                f"; force residual in it {number(held['force_residual_before_m_s2'], 3)} m/s² "
                f"before, "
                f"{number(held['force_residual_after_m_s2'], 3)} m/s² by the other cycles"
            )
        yield line
    for k, north in enumerate(result.north):
        yield (
            f"cycle {k + 1}: azimuth of the rotation axis by gyrocompassing alone "
            f"{np.mod(north['azimuth_deg'], 360.0):.3f}° ± {north['sigma_deg']:.2g}°"
        )
    flagged = result.refused["flagged_rows_by_cycle"]
    yield f"rows flagged by cycle: {', '.join(str(n) for n in flagged)}"
    if listed:
        yield from refused_lines(result)
    if result.not_tested:
        yield f"not tested: {'; '.join(result.not_tested)}"


def refused_lines(result: ResultContent) -> Iterator[str]:
    """Tell the measurements that the gate refused."""
    n, listed = result.refused["n"], result.refused["measurements"]
    if not n:
        yield "no measurement was refused"
        return
    yield f"{n} measurement(s) refused:"
    for one in listed[:SHOWN]:
        yield (
            f"  cycle {one['cycle']}, {one['time_s']:.1f} s, {one['channel']}: "
            f"{one['sigmas']:+.1f} sigmas"
        )
    if n > SHOWN:
        yield f"  and {n - SHOWN} more"


def observability_lines(result: ResultContent) -> Iterator[str]:
    """Tell what the data do not show."""
    o = result.observability
    values = o["singular_values"]
    yield (
        f"information relative to the prior: singular values from {number(max(values), 3)} "
        f"to {number(min(values), 3)}"
    )
    if o["not_observed"]:
        yield (
            f"not observed (sigma hardly below the prior sigma): {names_by_axis(o['not_observed'])}"
        )
    for one in o["not_told_apart"]:
        parts = " ".join(f"{w:+.2f}·{n}" for n, w in one.items()).replace("-", "−")
        yield f"not separable: {parts} (in sigmas of the prior)"
    if pairs := sorted(o["correlated"], key=lambda pair: -abs(pair["correlation"])):
        told = ", ".join(
            f"{' and '.join(pair['names'])} by {pair['correlation']:+.3f}" for pair in pairs[:FEW]
        )
        more = f", and {len(pairs) - FEW} more pairs beyond ±0.9" if len(pairs) > FEW else ""
        yield f"hardly separable, by their correlation: {told}{more}".replace("-", "−")


def names_by_axis(names: Sequence[str]) -> str:
    """Write names, those that differ by their last axis alone together: k0_t3_x, y, z."""
    stems: dict[str, list[str]] = {}
    for name in names:
        stem, _, axis = name.rpartition("_")
        key, end = (stem, axis) if axis in AXES else (name, "")
        stems.setdefault(key, []).append(end)
    return "; ".join(f"{s}_{', '.join(ends)}" if ends[0] else s for s, ends in stems.items())


def warning_lines(warnings: Sequence[str]) -> Iterator[str]:
    """Tell warnings; of one kind no more than a few, and how many there are."""
    kinds: dict[str, list[str]] = {}
    for one in warnings:
        kind, colon, _ = one.partition(": ")
        kinds.setdefault(kind if colon and " " not in kind else one, []).append(one)
    for kind, told in kinds.items():
        yield from (f"warning: {one}" for one in told[:FEW])
        if len(told) > FEW:
            yield f"warning: {kind}: {len(told) - FEW} more, all in the result's warnings"


def protection_lines(result: ResultContent) -> Iterator[str]:
    """Tell the protection level of each group: how large, by what, and what would lower it."""
    if not result.protection:
        return
    limits: Mapping[str, float] = result.protection["limits"]
    yield LEVELS
    if not result.consistency["passed"]:
        yield VOID
    for group, (name, one) in worst_levels(result).items():
        told = result.described(name).told_in
        unit, size = told.unit, told.size
        line = f"protection level of {group}: {number(one['total'] / size, 2)} {unit}"
        if group in limits:
            over = "above" if group in result.protection["exceeded"] else "within"
            line += f", {over} the limit of {number(limits[group] / size, 3)} {unit}"
        line += f"; three sigmas are {number(one['covariance'] / size, 2)} {unit}"
        if one["total"] > WELL_PROTECTED * one["covariance"]:
            line += (
                f", the rest is the possible effect of {one['worst']} undetected; to lower it: "
                f"{remedy(one['worst'])}"
            )
        yield line


def worst_levels(result: ResultContent) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """Return by group the parameter of the largest protection level, and that level."""
    out: dict[str, tuple[str, Mapping[str, Any]]] = {}
    levels: Mapping[str, Any] = result.protection["parameters"] if result.protection else {}
    for name, one in levels.items():
        group = result.described(name).group
        if group not in out or one["total"] > out[group][1]["total"]:
            out[group] = (name, one)
    return out


def remedy(effect: str) -> str:
    """Return what would make an effect show, or keep it from doing harm."""
    known = rig_library().by_name[effect]
    return known.experiment + (f", or --groups {effect}" if known.groups else "")


COLUMNS = ("parameter", "unit", "value ± 1 σ", "prior σ", "σ / prior")


def parameter_rows(result: ResultContent) -> Iterator[tuple[str, ...]]:
    """Yield a row for each parameter, in the unit people tell it in."""
    for name, one in result.parameters.items():
        told = result.described(name).told_in
        prior = result.prior[name].sigma
        ratio = number(one.sigma / prior, 2) if prior > 0 else "fixed"
        value = value_and_sigma(one.value / told.size, one.sigma / told.size)
        yield name, told.unit, value, number(prior / told.size, 3), ratio


def calibration_text(result: ResultContent) -> Iterator[RenderableType]:
    """Tell a calibration in words and a table."""
    made = table(*COLUMNS, right=COLUMNS[2:], keys=2)
    for row in parameter_rows(result):
        made.add_row(*row)
    yield made
    yield ""
    yield from judgement_lines(result)


def judgement_lines(result: ResultContent) -> Iterator[str]:
    """Tell how far a calibration can be trusted: its tests, what it shows, its warnings."""
    yield from calibration_sentences(result)
    yield from protection_lines(result)
    yield from observability_lines(result)
    yield from warning_lines(result.warnings)
