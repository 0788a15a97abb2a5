"""A verdict as the JSON of `accelbench discrepancy thermal`, and in words."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from accelbench.commands.discrepancy.shape_text import (
    shape_document,
    shape_lines,
    shares_in,
)
from accelbench.commands.discrepancy.shares_text import share_lines, shares_document
from accelbench.shell.console import micro_g, number, table
from errormodel.discrepancy.investigation import Conclusion
from thermo.discrepancy.find import Discrepancy
from thermo.discrepancy.shared import SharedEffect
from thermo.discrepancy.smallest import smallest_nameable
from thermo.discrepancy.words import EffectFound

VERDICT_WORDS = {
    "named": "named",
    "alias": "an effect is present, but these data cannot decide which of several",
    "unexplained_repeatable": "the residual repeats, but no effect of the library explains it",
    "unexplained_noise": "the residual is more than noise and does not repeat",
    "nothing": "nothing is missing",
}


def discrepancy_document(
    found: Sequence[Discrepancy], library: Path | None = None
) -> dict[str, Any]:
    """Return what `discrepancy --json` writes: the first accelerometer's keys, and all in a list.

    Parameters
    ----------
    found : sequence of Discrepancy
    library : Path, optional
        The library file that holds the shapes, if one is written.

    Returns
    -------
    dict
    """
    every = [_one(d, str(library) if library else None) for d in found]
    shared = [
        {"effect": s.effect, "serials": list(s.serials), "owner": s.owner}
        for s in all_shared(found)
    ]
    return {**every[0], "accelerometers": every, "shared": shared}


def all_shared(found: Sequence[Discrepancy]) -> tuple[SharedEffect, ...]:
    """Return the causes that several accelerometers shared, each once."""
    return tuple(dict.fromkeys(s for d in found for s in d.shared))


def _one(d: Discrepancy, library: str | None) -> dict[str, Any]:
    heldout, experiment, shares = d.heldout, d.experiment, shares_in(d)
    return {
        "serial": d.serial,
        "verdict": d.verdict,
        "effects": [_effect(e, shares.names.get(e.name, 0.0)) for e in d.effects],
        "alias_sets": [list(s) for s in d.alias_sets],
        "where": {"factor": d.where.name if d.where else None, "text": d.where_text},
        "rms_before_ug": d.rms_before_ug,
        "rms_after_ug": d.rms_after_ug,
        "floor_ug": d.floor_ug,
        "heldout": {
            "before_ug": heldout.before_ug if heldout else None,
            "after_ug": heldout.after_ug if heldout else None,
            "predictive": heldout.predictive if heldout else None,
            "runs": [
                {
                    "run": r.run,
                    "before_ug": r.before_ug,
                    "after_ug": r.after_ug,
                    "named_without_it": list(r.names),
                }
                for r in (heldout.runs if heldout else ())
            ],
        },
        "invisible": list(d.invisible),
        "smallest_nameable": {
            name: {"value": s.value, "unit": s.unit} for name, s in smallest_nameable(d).items()
        },
        "next_experiment": {
            "text": experiment.text,
            "separates": list(experiment.separates),
            "d_before": experiment.d_before,
            "d_after": experiment.d_after,
            "hours": experiment.hours,
        }
        if experiment
        else None,
        "something_left": d.judgement.loud or d.judgement.loud_noise,
        **conclusion_document(d),
        **shares_document(d, shares),
        "shape": shape_document(d, library),
        "noise": {
            "family": d.floor.noise.family,
            "white_ug": d.floor.noise.white,
            "slow_ug": [d.floor.noise.drift for _ in d.floor.noise.slow_tau_s],
            "tau_s": list(d.floor.noise.slow_tau_s),
        },
        "fit_first": list(d.fit_first),
        "refuted": [u.effect for u in d.refuted],
        "baseline": [t.name for t in d.before.model.terms],
        "model": [t.name for t in d.after.model.terms],
    }


def conclusion_document(d: Conclusion[Any, Any]) -> dict[str, Any]:
    """Return what every search says of its verdict: shares, factors, rivals."""
    return {
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


def _effect(e: EffectFound, share: float) -> dict[str, Any]:
    return {
        "name": e.name,
        "parameters": {
            n: {"value": p.value, "sigma": p.sigma, "unit": p.unit} for n, p in e.parameters.items()
        },
        "strength_d": e.strength_d,
        "share": share,
        "p_value": e.p_value,
        "sentence": e.sentence,
    }


def discrepancy_text(found: Sequence[Discrepancy]) -> Iterator[RenderableType]:
    """Tell verdicts in words and tables."""
    for d in found:
        yield f"{d.serial}: {VERDICT_WORDS[d.verdict]}"
        for line in verdict_lines(d):
            yield f"  {line}"
        if d.effects:
            yield _effects_table(d)
        if d.heldout:
            yield _heldout_table(d)
        yield ""
    yield from shared_lines(found)


def shared_lines(found: Sequence[Discrepancy]) -> Iterator[str]:
    """Say which causes several accelerometers shared."""
    for s in all_shared(found):
        told = ", ".join(s.serials)
        if s.owner == "run":
            yield (
                f"{s.effect} came to {told} in the same runs: look for a cause in the run, not "
                f"in one accelerometer."
            )
        else:
            yield f"{s.effect} has the same size in {told}, like an error of the {s.owner}."


def larger(d: Discrepancy) -> bool:
    """Tell whether something is added to the present model, with a name or without."""
    return bool(d.effects) or d.shape is not None


def rival_lines(d: Conclusion[Any, Any]) -> Iterator[str]:
    """Say what else it could have been, and what not."""
    for s in d.alias_sets:
        yield f"These data cannot separate: {', '.join(s)}."
    unexplained = d.verdict.startswith("unexplained")
    for slot in d.result.slots if not unexplained else ():
        excluded = [f"{n} (by {number(b, 3)})" for n, b in slot.rivals if n not in slot.alias][:3]
        if excluded:
            yield f"Next to {slot.choice.name}, excluded: {', '.join(excluded)}."


def verdict_lines(d: Discrepancy) -> Iterator[str]:
    """Say what was found, in sentences."""
    if d.source.seen.runs == 1:
        yield "One run does not show what repeats: a slow change may be noise or an effect."
    if d.fit_first:
        yield (
            "The present model lacks several terms of its own equation at once; fit these first: "
            f"{', '.join(d.fit_first)}."
        )
    yield d.where_text
    for u in d.refuted:
        yield u.sentence
    for e in d.effects:
        yield f"{e.name}: {e.sentence} Strength {number(e.strength_d, 3)}, p {number(e.p_value, 2)}"
    yield from rival_lines(d)
    yield from share_lines(d, shares_in(d))
    yield from shape_lines(d)
    after = f", {micro_g(d.rms_after_ug)} with the effect" if larger(d) else ""
    yield (
        f"Residual {micro_g(d.rms_before_ug)} with the present model{after}; noise alone "
        f"{micro_g(d.floor_ug)}."
    )
    if d.heldout and not d.heldout.predictive:
        yield (
            "The effect does not repeat: a held-out run cannot be predicted from the others, and "
            "its residual does not contradict the name."
        )
    if d.invisible:
        yield f"These runs cannot show at all: {', '.join(d.invisible)}."
    if d.experiment:
        yield f"Next experiment: {d.experiment.text}."


def _effects_table(d: Discrepancy) -> RenderableType:
    made = table("effect", "parameter", "value", "sigma", "unit", right=("value", "sigma"))
    known = {e.name: e for e in d.source.effects}
    for e in d.effects:
        for name, p in e.parameters.items():
            label = known[e.name].name
            made.add_row(label, name, number(p.value), number(p.sigma, 2), p.unit)
    return made


def _heldout_table(d: Discrepancy) -> RenderableType:
    assert d.heldout is not None
    floor = number(d.floor_ug)
    if not larger(d):
        names = ("residual µg", "noise µg")
        made = table("run held out", *names, right=names)
        for r in d.heldout.runs:
            made.add_row(r.run, number(r.before_ug), floor)
        return made
    names = ("before µg", "after µg", "noise µg")
    made = table("run held out", *names, "named without it", right=names)
    for r in d.heldout.runs:
        named = ", ".join(r.names) or "–"
        made.add_row(r.run, number(r.before_ug), number(r.after_ug), floor, named)
    return made
