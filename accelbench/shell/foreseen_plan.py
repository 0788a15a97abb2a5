"""A dry run: the plan, and what can be learnt from it for each way an accelerometer is mounted."""

from dataclasses import dataclass
from typing import Any

from errormodel.progress import stage, track
from thermo.discrepancy.foresee import EffectsForeseen, foresee_effects
from thermo.planning.foresight import CoefficientForesight, foresee_coefficients
from thermo.planning.plan import Plan
from thermo.planning.text import mounting_lines, plan_lines


@dataclass(frozen=True, slots=True, kw_only=True)
class MountingForeseen:
    """Foresight for the accelerometers of one mounting; units and K1's scale are the first's."""

    serials: tuple[str, ...]
    coefficients: CoefficientForesight
    effects: EffectsForeseen


def foresee_plan(plan: Plan) -> tuple[MountingForeseen, ...]:
    """Foresee a test, once for each mounting in the order of the sequence's accelerometers."""
    runs = [plan.run(number) for number in range(1, plan.runs + 1)]
    units = {i.serial: i.output_unit for i in plan.station.inputs}
    accelerometers = plan.sequence.accelerometers
    made: list[MountingForeseen] = []
    for mount_deg in track(tuple(dict.fromkeys(a.mount_deg for a in accelerometers))):
        alike = [a for a in accelerometers if a.mount_deg == mount_deg]
        with stage(0.0, 0.5):
            coefficients = foresee_coefficients(
                runs,
                nominal_scale=alike[0].nominal_scale,
                output_unit=units[alike[0].serial],
                mount_deg=mount_deg,
            )
        with stage(0.5, 1.0):
            effects = foresee_effects(runs, mount_deg=mount_deg)
        serials = tuple(a.serial for a in alike)
        made.append(MountingForeseen(serials=serials, coefficients=coefficients, effects=effects))
    return tuple(made)


def plan_text(plan: Plan, foreseen: tuple[MountingForeseen, ...]) -> tuple[str, ...]:
    """Tell plan and foresight in plain lines."""
    lines: list[str] = []
    for one in foreseen:
        if len(foreseen) > 1:
            lines.append(f"{', '.join(one.serials)}:")
        lines += [*one.coefficients.lines(), *one.effects.lines()]
    return plan_lines(plan, lambda _: lines)


def plan_document(plan: Plan, foreseen: tuple[MountingForeseen, ...]) -> dict[str, Any]:
    """Return what `run --dry-run --json` writes; the first mounting's foresight is at the top."""
    by_mounting = [_foreseen(one) for one in foreseen]
    return {
        "sequence": plan.sequence.name,
        "station": plan.station.name,
        "duration_s": plan.total_s,
        "runs": plan.runs,
        "run_s": plan.run_s,
        "rest_s": plan.rest_s,
        "slots": plan.slots,
        "readings": plan.readings,
        "mounting": list(mounting_lines(plan.sequence)),
        "expected_sigmas": by_mounting[0]["expected_sigmas"],
        "not_separable": by_mounting[0]["not_separable"],
        "by_mounting": by_mounting,
        "text": list(plan_text(plan, foreseen)),
    }


def _foreseen(one: MountingForeseen) -> dict[str, Any]:
    return {
        "mount_deg": one.coefficients.mount_deg,
        "serials": list(one.serials),
        "expected_sigmas": {
            e.name: {"sigma": e.sigma, "unit": e.unit} for e in one.coefficients.expected
        },
        "not_separable": [list(group) for group in one.coefficients.confounded],
        "effects_not_shown": list(one.effects.invisible),
        "effects_alike": [list(pair) for pair in one.effects.alike],
    }
