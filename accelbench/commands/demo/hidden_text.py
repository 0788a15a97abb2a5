"""The demonstration of a hidden effect told: as JSON, and in words."""

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType

from accelbench.commands.demo.hidden import HiddenDemo
from accelbench.commands.demo.hidden_page import NEXT_RUN_NAME, next_run_lines
from accelbench.commands.discrepancy.text import discrepancy_document, discrepancy_text
from accelbench.shell.console import number
from thermo.discrepancy.smallest import smallest_nameable
from thermo.twin.unknown import UNKNOWN


def hidden_document(one: HiddenDemo) -> dict[str, Any]:
    """Return what `demo --hidden --json` writes."""
    beside = one.next_run
    return {
        "folder": str(one.folder),
        "hidden": {"serial": one.serial, "effect": one.effect, "size": one.size},
        "right": one.right,
        "discrepancy": discrepancy_document(one.verdicts) if one.verdicts else None,
        "experiments": [e.text for e in one.experiments],
        "next_run": {
            "serial": beside.serial,
            "before_ug": beside.gap_before_ug,
            "after_ug": beside.gap_after_ug,
            "floor_ug": beside.floor_ug,
            "over_noise": beside.over_noise,
            "predictive": beside.predictive,
            "level_after_ug": float(beside.line(beside.after_ug)[1]),
            "slope_after_ug_per_h": float(beside.line(beside.after_ug)[0]),
        }
        if beside
        else None,
        "seconds": one.seconds,
        "report": str(one.report) if one.report else None,
        "failed": one.failed.reason if one.failed else None,
    }


def hidden_text(one: HiddenDemo) -> Iterator[RenderableType]:
    """Tell verdicts, the key beside them, and the gap in the next run."""
    if one.failed is not None:
        yield f"the test ended early: {one.failed.status}, {one.failed.reason}"
        return
    yield from discrepancy_text(one.verdicts)
    for e in one.experiments:
        yield f"Follow-up experiment, because the answer was open: {e.text}."
    yield f"The key, opened now: {one.serial} was given {one.effect}: {one.size}."
    yield _judged(one)
    if one.next_run is not None:
        yield from next_run_lines(one.next_run)
    yield f"{number(one.seconds, 3)} s in all"
    if one.report is not None:
        yield f"report: {one.report}, and {NEXT_RUN_NAME} beside it"


def _judged(one: HiddenDemo) -> str:
    if one.right and one.effect == UNKNOWN:
        return "Rightly found to be in no library, and a shape built; nothing in the others."
    if one.right:
        return "Named rightly, and nothing in the others."
    mine = next(d for d in one.verdicts if d.serial == one.serial)
    false = [d.serial for d in one.verdicts if d.serial != one.serial and d.verdict != "nothing"]
    said = [e.name for e in mine.effects]
    if any(one.effect in s for s in mine.alias_sets):
        text = "It is in the set that these runs cannot separate"
    elif said:
        text = f"Named wrongly: {', '.join(said)}"
    else:
        text = f"{'No shape' if one.effect == UNKNOWN else 'Not named'}: {mine.verdict}"
        least = smallest_nameable(mine).get(one.effect)
        if least is not None:
            text += (
                f"; these runs would name it from about {number(least.value, 2)} {least.unit} on"
            )
    return text + (f"; false verdicts: {', '.join(false)}." if false else ".")
