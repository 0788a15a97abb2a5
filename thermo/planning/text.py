"""A plan told in plain lines, for a dry run."""

from collections.abc import Callable, Sequence

import numpy as np

from thermo.planning.plan import Plan, coverage
from thermo.planning.sequence import Sequence as TestSequence

MAX_LEGS_SHOWN = 40
MAX_ANGLES_SHOWN = 12

Foresight = Callable[[Plan], Sequence[str]]


def duration_text(seconds: float) -> str:
    """Tell a duration as ``7 h 20 min`` or, below an hour, ``12 min 30 s``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


def plan_lines(plan: Plan, foresight: Foresight | None = None) -> tuple[str, ...]:
    """Tell a plan.

    Parameters
    ----------
    plan : Plan
    foresight : callable, optional
        Says, in lines, what a model can and cannot separate with this plan and the sigmas to
        expect; it finds the predicted readings in ``plan.run(number)``.

    Returns
    -------
    tuple of str
    """
    sequence = plan.sequence
    serials = ", ".join(a.serial for a in sequence.accelerometers)
    lines = [
        f"sequence   {sequence.name} on {plan.station.name} ({plan.station.chamber.model})",
        f"under test {len(sequence.accelerometers)}: {serials}",
        *(f"mounting   {line}" for line in mounting_lines(sequence)),
        f"duration   {duration_text(plan.total_s)}: {plan.runs} × ("
        f"{duration_text(plan.approach_s)} approach + {duration_text(plan.run_s)} run)"
        + (f" + {plan.runs - 1} × {duration_text(plan.rest_s)} rest" if plan.runs > 1 else ""),
        f"readings   {plan.readings}: one every {sequence.sampling.period_s:g} s, "
        f"{plan.slots} slots a run, a scan takes {plan.scan_s:.2g} s",
        f"after a gap {_gap_text(plan)}",
        *_run_in_lines(plan),
        "",
        "segment   from      to        °C → °C            °C/min",
    ]
    lines += _leg_lines(plan)
    if plan.runs > 1:
        lines.append(
            f"between runs the accelerometers are switched off by hand or timer; the chamber is "
            f"at {plan.rest_temp_c:g} °C"
        )
    lines += ["", *_coverage_lines(plan)]
    if foresight is not None:
        lines += ["", *foresight(plan)]
    return tuple(lines)


def mounting_lines(sequence: TestSequence) -> tuple[str, ...]:
    """Say which accelerometers are to be mounted turned on the head; nothing where none is."""
    by_angle: dict[float, list[str]] = {}
    for one in sequence.accelerometers:
        by_angle.setdefault(one.mount_deg, []).append(one.serial)
    usual = by_angle.pop(0.0, [])
    lines = [
        f"turn {', '.join(serials)} by {angle:+g}° on the head before the start; with the head at "
        f"0° each then reads {np.sin(np.deg2rad(angle)):+.3f} g"
        for angle, serials in by_angle.items()
    ]
    if lines and usual:
        lines.append(f"{', '.join(usual)} as usual: 0 g with the head at 0°")
    return tuple(lines)


def _run_in_lines(plan: Plan) -> list[str]:
    rule = plan.sequence.run_in
    if rule is None:
        return []
    return [
        f"run-in stops automatically after {rule.min_cycles} to {rule.max_cycles} runs, when K0 "
        f"(K1) of each accelerometer changes by no more than {rule.k0_limit_ug:g} µg "
        f"({rule.k1_limit_ppm:g} ppm) from then on, confidence {100 * rule.confidence:g} %"
    ]


def _gap_text(plan: Plan) -> str:
    rule = plan.sequence.after_gap
    resoak = f"hold the start of the segment for {rule.resoak_min:g} min and repeat the segment"
    if rule.gap_rule == "resoak":
        return resoak
    return f"up to {rule.max_gap_s:g} s: continue and mark the gap; longer: {resoak}"


def _leg_lines(plan: Plan) -> list[str]:
    lines = [
        f"{leg.index:>7}   {duration_text(leg.start_s):<11} {duration_text(leg.end_s):<11} "
        f"{leg.start_c:7.1f} → {leg.end_c:<7.1f} {leg.rate_c_per_min:+8.2f}"
        for leg in plan.legs[:MAX_LEGS_SHOWN]
    ]
    if len(plan.legs) > MAX_LEGS_SHOWN:
        lines.append(f"      … and {len(plan.legs) - MAX_LEGS_SHOWN} more")
    return lines


def _coverage_lines(plan: Plan, bin_c: float = 10.0) -> list[str]:
    counts = coverage(plan, bin_c)
    edges = sorted({edge for edge, _ in counts})
    angles = sorted({angle for _, angle in counts})
    shown = angles[:MAX_ANGLES_SHOWN]
    rest = f"  … {len(angles) - len(shown)} more" if len(angles) > len(shown) else ""
    lines = ["readings of each accelerometer by predicted temperature and position"]
    lines.append(" " * 16 + "".join(f"{angle:>7g}°" for angle in shown) + rest)
    for edge in edges:
        row = "".join(f"{counts.get((edge, angle), 0):>8}" for angle in shown)
        lines.append(f"{edge:+6g}…{edge + bin_c:+g} °C".ljust(16) + row)
    return lines
