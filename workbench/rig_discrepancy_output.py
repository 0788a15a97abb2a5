"""The verdict on a rig run told: as JSON, in words, and as the larger model."""

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType

from sinscal.discrepancy import RigDiscrepancy
from sinscal.rig_model_file import BiasStep, FoundValue, RigModelFile
from workbench.console import number, table
from workbench.discrepancy_output import VERDICT_WORDS


def where_words(d: RigDiscrepancy) -> str:
    """Say in words which factor carries the excess."""
    if d.where is None:
        return "The innovations are what the noise stated makes."
    if d.effects:
        name = max(d.effects, key=lambda e: e.strength_d).effect.name
        return f"Most of the excess is in {d.channel}; {name} goes with the {d.where}."
    return f"Most of the excess is in {d.channel}; it follows the {d.where} most closely."


def rig_document(d: RigDiscrepancy) -> dict[str, Any]:
    """Return what `discrepancy rig --json` writes."""
    return {
        "verdict": d.verdict,
        "mode": d.source.mode,
        "effects": [
            {
                "name": e.effect.name,
                "parameters": {
                    n: {"value": p.value, "sigma": p.sigma, "unit": p.unit}
                    for n, p in e.parameters.items()
                },
                "strength_d": e.strength_d,
                "p_value": e.p_value,
                "sentence": e.effect.sentence,
            }
            for e in d.effects
        ],
        "alias_sets": [list(s) for s in d.alias_sets],
        "where": {"factor": d.where, "channel": d.channel, "text": where_words(d)},
        "rms_before_si": d.rms_before,
        "rms_after_si": d.rms_after,
        "floor_si": d.floor,
        "heldout": {
            "runs": [
                {"cycle": h.cycle, "before_si": h.before, "after_si": h.after} for h in d.heldout
            ]
        },
        "invisible": list(d.invisible),
        "smallest_nameable": {
            n: {"value": v, "unit": u} for n, (v, u) in d.smallest_nameable.items()
        },
        "next_experiment": {"text": d.experiment} if d.experiment else None,
        "explained_share": d.judgement.explained_share,
        "factors": [
            {"factor": f.name, "excess_chi2": f.excess, "p_value": f.p_value}
            for f in d.judgement.rest
        ],
        "rivals": [
            {s.choice.name: [{"name": n, "below": b} for n, b in s.rivals[:4]]}
            for s in d.result.slots
        ],
    }


def rig_text(d: RigDiscrepancy) -> Iterator[RenderableType]:
    """Tell the verdict in words and tables."""
    yield VERDICT_WORDS[d.verdict]
    yield where_words(d)
    for e in d.effects:
        strength, p = number(e.strength_d, 3), number(e.p_value, 2)
        yield f"{e.effect.name}: {e.effect.sentence} Strength {strength}, p {p}"
    for s in d.alias_sets:
        yield f"This run cannot tell apart: {', '.join(s)}."
    if d.effects:
        made = table("parameter", "value", "sigma", "unit", right=("value", "sigma"))
        for e in d.effects:
            for name, p in e.parameters.items():
                made.add_row(name, number(p.value), number(p.sigma, 2), p.unit)
        yield made
    names = ("before", "after", "noise alone")
    gaps = table("innovations, rms (m/s², rad)", *names, right=names)
    for name, floor in d.floor.items():
        row = (d.rms_before.get(name, float("nan")), d.rms_after[name], floor)
        gaps.add_row(name, *(number(v, 3) for v in row))
    yield gaps
    if d.invisible:
        yield f"This run cannot show at all: {', '.join(d.invisible)}."
    if d.experiment:
        yield f"Next experiment: {d.experiment}."


def enlarged(d: RigDiscrepancy) -> RigModelFile:
    """Return the larger model: the present one and what was found."""
    present = d.source.present
    steps = [
        BiasStep(kind=e.effect.step, at_s=e.parameters[f"{e.effect.name}_at_s"].value)
        for e in d.effects
        if e.effect.step in ("gyro", "accel")
    ]
    found = {
        e.effect.name: {
            n: FoundValue(value=p.value, sigma=p.sigma, unit=p.unit)
            for n, p in e.parameters.items()
        }
        for e in d.effects
    }
    groups = (*present.groups, *(g for e in d.effects for g in e.effect.groups))
    return RigModelFile(
        mode=d.source.mode,
        t_ref_c=present.t_ref_c,
        groups=tuple(dict.fromkeys(groups)),
        mount=present.mount or "rig_mount" in found,
        steps=(*present.steps, *steps),
        effects={**present.effects, **found},
    )
