"""Result of `accelbench run`, as a document and in words."""

import shlex
from dataclasses import dataclass
from typing import Any

from rich.console import RenderableType

from accelbench.commands.run.ramps import ramp_lines
from accelbench.commands.run_in.text import run_in_document, run_in_text
from thermo.run_in.verdict import RunInVerdict
from thermo.station.checks.uniformity import RampVerdict
from thermo.station.observers.live import LiveEstimate
from thermo.station.outcome import TestOutcome


@dataclass(frozen=True, slots=True, kw_only=True)
class Afterwards:
    """Evaluation of a test when it was over.

    Attributes
    ----------
    verdicts : tuple of RampVerdict
    exported : tuple of str
    settled : tuple of RunInVerdict or None
        None when there was no run-in, empty when it cannot be judged.
    problems : tuple of str
        What could not be done, and how to come by it.
    out : str
        Where the recorded run was asked for; empty when it was not.
    in_store, repeated : int or None
        Of a test that was resumed: its readings in the store, and those of them that were measured
        again after the interruption and are not exported.
    """

    verdicts: tuple[RampVerdict, ...] = ()
    exported: tuple[str, ...] = ()
    settled: tuple[RunInVerdict, ...] | None = None
    problems: tuple[str, ...] = ()
    out: str = ""
    in_store: int | None = None
    repeated: int | None = None

    @property
    def all_settled(self) -> bool:
        """True when every accelerometer of a run-in has settled; True when there was none."""
        return self.settled is None or (bool(self.settled) and all(v.settled for v in self.settled))


def run_document(
    outcome: TestOutcome, after: Afterwards, store: str, live: LiveEstimate
) -> dict[str, Any]:
    """Return a test's result for JSON; `store` as it may be shown."""
    return {
        "test_id": outcome.test_id,
        "status": outcome.status,
        "reason": outcome.reason,
        "readings": outcome.readings,
        "readings_in_store": after.in_store,
        "readings_repeated": after.repeated,
        "skipped": outcome.skipped,
        "flagged": outcome.flagged,
        "safe": {
            "verified": outcome.safe.verified,
            "commanded": outcome.safe.commanded,
            "steps": list(outcome.safe.steps),
        },
        "head_stopped": outcome.head_stopped,
        "complaints": list(outcome.complaints),
        "uniformity": [uniformity_document(v) for v in after.verdicts],
        "live": [
            {
                "serial": v.serial,
                "temp_c": v.temp_c,
                "k0_ug": v.k0_ug,
                "k0_sigma_ug": v.k0_sigma_ug,
                "k1_relative": v.k1,
                "k1_sigma_ppm": v.k1_sigma_ppm,
                "t_ref_c": v.t_ref_c,
                "k0_ref_ug": v.k0_ref_ug,
                "k0_ref_sigma_ug": v.k0_ref_sigma_ug,
                "k1_ref_relative": v.k1_ref,
                "k1_ref_sigma_ppm": v.k1_ref_sigma_ppm,
            }
            for v in live.values()
        ],
        "store": store,
        "store_note": outcome.store_note,
        "exported": list(after.exported),
        "problems": list(after.problems),
        "run_in": None if after.settled is None else run_in_document(after.settled),
    }


def uniformity_document(v: RampVerdict) -> dict[str, Any]:
    """Return one ramp's verdict for JSON; rates in °C/min."""
    return {
        "serial": v.serial,
        "run": v.run,
        "segment": v.segment,
        "commanded_c_per_min": v.commanded,
        "measured_c_per_min": v.measured,
        "measured_sigma_c_per_min": v.measured_sigma,
        "share_inside": v.share_inside,
        "half_band_c_per_min": v.half_band,
        "readings": v.readings,
        "longest_outside_min": v.longest_outside_min,
        "unread_min": v.unread_min,
        "thermistor_noise_c": v.noise_c,
        "passed": v.passed,
        "sins_rate_c_per_min": v.sins_rate,
        "mismatch_percent": v.mismatch_percent,
        "sentence": v.sentence,
    }


def run_text(
    outcome: TestOutcome, after: Afterwards, store: str, *, verbose: bool = False
) -> list[RenderableType]:
    """Return the same in words; `verbose` tells every ramp."""
    lines = [f"test {outcome.test_id or '(not begun)'} {outcome.status}: {outcome.reason}"]
    lines.append(
        f"{outcome.readings} readings stored in {store}"
        + (" since it was resumed" if after.in_store is not None else "")
        + f", {outcome.skipped} slots without a reading, {outcome.flagged} readings flagged"
    )
    if after.in_store is not None:
        lines.append(
            f"in total the store has {after.in_store} readings in all"
            + (
                f"; {after.repeated} of them, of the interrupted part of a run, were measured "
                "again and are not exported"
                if after.repeated
                else ""
            )
        )
    if outcome.store_note:
        lines.append(f"store: {outcome.store_note}")
    lines += [f"complaint: {text}" for text in outcome.complaints]
    if outcome.safe.commanded:
        safe = "verified" if outcome.safe.verified else "NOT VERIFIED: check the chamber"
        lines.append(f"chamber's safe condition {safe}: {'; '.join(outcome.safe.steps)}")
    else:
        lines.append(f"chamber: not commanded; {'; '.join(outcome.safe.steps)}")
    lines += ramp_lines(after.verdicts, verbose=verbose)
    ended = outcome.status == "finished"
    what = "recorded run" if ended else "recorded run of the readings so far"
    lines += [f"{what}: {path}" for path in after.exported]
    lines += after.problems
    if not ended and outcome.test_id:
        resume = ["run", "--resume", outcome.test_id, "--store", store]
        if after.exported and after.out:
            resume += ["--out", after.out, "--force"]
        lines.append(f"resume with: accelbench {shlex.join(resume)}")
    return [*lines, *run_in_text(after.settled or ())]
