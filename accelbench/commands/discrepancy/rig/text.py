"""The verdict on a rig run: as JSON, in words, and as the larger model."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from rich.console import RenderableType

from accelbench.commands.discrepancy.shares_text import share_lines, shares_document
from accelbench.commands.discrepancy.text import VERDICT_WORDS, conclusion_document, rival_lines
from accelbench.commands.fit.text import value_and_sigma
from accelbench.shell.console import number, table
from errormodel.discrepancy.shares import shares_of
from errormodel.terms import Told
from sinscal.calibration.consistency import FORCES
from sinscal.discrepancy.find import RigDiscrepancy
from sinscal.discrepancy.held_out import CycleGap
from sinscal.discrepancy.noise import MeasuredNoise
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.library import rig_library
from sinscal.library.angle import MOUNT
from sinscal.model.larger_model import BiasStep, FoundValue, RigModelFile


def where_words(d: RigDiscrepancy) -> str:
    """Say in words which factor carries the excess."""
    if d.where is None:
        return "The innovations are consistent with noise alone."
    if d.effects:
        name = max(d.effects, key=lambda e: e.strength_d).effect.name
        return f"Most of the excess is in {d.channel}; {name} goes with the {d.where}."
    return f"Most of the excess is in {d.channel}; it follows the {d.where} most closely."


def rig_document(d: RigDiscrepancy) -> dict[str, Any]:
    """Return what `discrepancy rig --json` writes."""
    shares = shares_of(d)
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
                "share": shares.names.get(e.effect.name, 0.0),
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
        "gaps": [_gap(g) for g in d.gaps],
        "heldout": {
            "runs": [{**_gap(g), "named_without_it": list(g.names)} for g in d.held_out_parts],
        },
        "invisible": list(d.invisible),
        "smallest_nameable": {
            n: {"value": v, "unit": u} for n, (v, u) in d.smallest_nameable.items()
        },
        "drift": {
            "kind": d.drift.kind,
            "family": d.drift.family,
            "size_si": d.drift.sigma,
            "tau_s": d.drift.tau_s,
            "text": d.drift.sentence,
        }
        if d.drift
        else None,
        "next_experiment": {"text": d.experiment} if d.experiment else None,
        "noise": {
            n.sensors: {
                "stated": n.stated,
                "measured": n.found.value,
                "sigma": n.found.sigma,
                "unit": n.unit,
                "differs": n.differs,
            }
            for n in d.noise
        },
        **conclusion_document(d),
        **shares_document(d, shares),
    }


def _gap(g: CycleGap) -> dict[str, Any]:
    return {"cycle": g.cycle, "before_si": g.before, "after_si": g.after}


def rig_lines(d: RigDiscrepancy) -> Iterator[str]:
    """Say what was found, in sentences."""
    yield where_words(d)
    for e in d.effects:
        strength, p = number(e.strength_d, 3), number(e.p_value, 2)
        yield f"{e.effect.name}: {e.effect.sentence} Strength {strength}, p {p}."
    yield from rival_lines(d)
    yield from share_lines(d, shares_of(d))
    if d.drift:
        told = d.drift.sentence
        yield f"{told[0].upper()}{told[1:]}: a random walk, or an unrecorded change of temperature."
    before, after, floor = (rms_of_forces(v) for v in (d.rms_before, d.rms_after, d.floor))
    yield (
        f"Innovations of the forces {number(before, 3)} m/s² rms with the present model, "
        f"{number(after, 3)} m/s² with the effect; noise alone {number(floor, 3)} m/s²."
    )
    for n in d.noise:
        if n.differs:
            yield f"The noise stated beside the run is not its noise: {told_noise(n)}."
    for g in d.held_out_parts:
        if set(g.names) != {e.effect.name for e in d.effects}:
            others = " and ".join(g.names) or "nothing"
            yield f"Without cycle {g.cycle} the others would name {others}."
    if d.invisible:
        yield f"This run cannot show at all: {', '.join(d.invisible)}."
    if d.experiment:
        yield f"Next experiment: {d.experiment}."


def told_noise(n: MeasuredNoise) -> str:
    """Return a density as measured, with its sigma, beside what is stated of it."""
    name, unit, size = {
        "gyro": ("gyros", "°/h/√Hz", DEG_PER_H),
        "accel": ("accelerometers", "m/s²/√Hz", 1.0),
        "angle": ("the rig's angle", "″/√Hz", ARCSEC),
    }[n.sensors]
    stated = f"stated {number(n.stated / size, 3)}" if n.stated else "not stated"
    measured = value_and_sigma(n.found.value / size, n.found.sigma / size)
    return f"{name} {measured} {unit}, {stated}"


def rms_of_forces(by_channel: Mapping[str, float]) -> float:
    """Return the rms over the channels of force."""
    forces = [v for n, v in by_channel.items() if n in FORCES]
    return float(np.sqrt(np.mean(np.square(forces)))) if forces else float("nan")


def told_parameters(d: RigDiscrepancy) -> Iterator[tuple[str, str, str, str]]:
    """Yield effect, parameter, value and sigma, and the unit people tell it in."""
    for e in d.effects:
        for name, p in e.parameters.items():
            one = rig_library().parameters.get(name)  # the time of a jump is none
            told = one.told_in if one else Told(unit=p.unit)
            value = value_and_sigma(p.value / told.size, p.sigma / told.size)
            yield e.effect.name, name, value, told.unit


def rig_text(d: RigDiscrepancy) -> Iterator[RenderableType]:
    """Tell the verdict in words and tables."""
    yield VERDICT_WORDS[d.verdict]
    yield from rig_lines(d)
    if d.effects:
        made = table("effect", "parameter", "value ± 1 σ", "unit", right=("value ± 1 σ",))
        for row in told_parameters(d):
            made.add_row(*row)
        yield made
    names = ("before", "after", "noise alone")
    gaps = table("innovations, rms (m/s², rad)", *names, right=names)
    for name, floor in d.floor.items():
        row = (d.rms_before.get(name, float("nan")), d.rms_after[name], floor)
        gaps.add_row(name, *(number(v, 3) for v in row))
    yield gaps


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
        mount=present.mount or MOUNT in found,
        steps=(*present.steps, *steps),
        effects={**present.effects, **found},
    )
