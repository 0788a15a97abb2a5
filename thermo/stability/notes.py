"""Notes on a batch: what cannot be compared, and what must be known of what can."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.errors import InputError
from thermo.recording.files import RecordedRuns
from thermo.stability.runs import MIN_READINGS, RunByRun, residual_factors

NOISIER = 1.5  # times the noise of a run with the least, from which it is told
SLOW = 1.0  # of a run's length: a drift with a longer time constant looks like a step between runs


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOutRun:
    """An accelerometer (`run_id` None) or one run of it that is not compared, and why."""

    serial: str
    run_id: str | None
    reason: str

    @property
    def sentence(self) -> str:
        """Say it in one line."""
        run = "" if self.run_id is None else f", run {self.run_id}"
        return f"{self.serial}{run}: left out, {self.reason}"


def comparable(runs: RecordedRuns) -> tuple[RecordedRuns, tuple[LeftOutRun, ...]]:
    """Return the accelerometers that have two runs to compare, and what is left out.

    Raises
    ------
    InputError
        If nothing is left.
    """
    left_out: list[LeftOutRun] = []
    keep = np.zeros(len(runs), dtype=bool)
    for k, serial in enumerate(runs.serials):
        mine = (runs.serial.codes == k) & runs.good
        counts = np.bincount(runs.run.codes[mine], minlength=len(runs.run_ids))
        enough = np.flatnonzero(counts >= MIN_READINGS)
        short = np.flatnonzero((counts > 0) & (counts < MIN_READINGS))
        left_out += [
            LeftOutRun(
                serial=serial,
                run_id=runs.run_ids[int(r)],
                reason=f"{counts[r]} good readings; a run needs {MIN_READINGS} at least",
            )
            for r in short
        ]
        if enough.size >= 2:
            keep |= (runs.serial.codes == k) & np.isin(runs.run.codes, enough)
        else:
            reason = f"{enough.size} run with good readings; run-to-run stability needs two or more"
            left_out.append(LeftOutRun(serial=serial, run_id=None, reason=reason))
    if not np.any(keep):
        said = "; ".join(o.reason for o in left_out if o.run_id is None)
        raise InputError(runs.source, f"serial {', '.join(runs.serials)}", said)
    return (runs.take(np.flatnonzero(keep)) if left_out else runs), tuple(left_out)


def notes_of(one: RunByRun, temperatures: Sequence[float]) -> tuple[str, ...]:
    """Say what a reader of an accelerometer's figures must know."""
    notes = [
        f"run {r.run_id} cannot determine {', '.join(r.held)}: held as of all runs"
        for r in one.runs
        if r.held
    ]
    low, high = max(r.temp_c[0] for r in one.runs), min(r.temp_c[1] for r in one.runs)
    if low > high:
        notes.append("the runs share no temperature: coefficients are compared extrapolated")
    notes += [
        f"{t:g} °C lies outside the range that all runs share, {low:.3g} to {high:.3g} °C: "
        "coefficients there are extrapolated"
        for t in temperatures
        if low <= high and not low <= t <= high
    ]
    if not one.joint.channel.has_input:
        notes.append("the input is not recorded: K0 includes it, and K1 cannot be fitted")
    if not one.scale_fitted:
        notes.append("no K1 was fitted: values in µg use the nominal scale factor")
    least = min(one.noise_ratios.values())
    notes += [
        f"run {r} is {ratio / least:.2g} times as noisy as the quietest one; its sigmas include "
        f"this"
        for r, ratio in one.noise_ratios.items()
        if ratio > NOISIER * least
    ]
    notes += _hidden(one, least)
    record = one.joint.channel.record
    spans = [float(np.ptp(record.time_s[rows])) for rows in record.run_slices]
    tau_s, drift_ug = one.noise.drift_tau_s, 1e6 * one.noise.drift
    if drift_ug > 0.0 and tau_s > SLOW * min(spans):
        notes.append(
            f"a drift of {drift_ug:.2g} µg with a time constant of {tau_s / 3600:.2g} h is "
            f"present within the runs: drift so slow cannot be separated from a difference "
            f"between runs"
        )
    return tuple(notes)


def _hidden(one: RunByRun, least: float) -> Iterator[str]:
    """Tell what a quiet run shows that the noise of others hid from the choice of the model."""
    if max(one.noise_ratios.values()) <= NOISIER * least:
        return
    for run in one.runs:
        if one.noise_ratios[run.run_id] > NOISIER * least:
            continue
        if found := residual_factors(one, run)[:1]:
            yield (
                f"run {run.run_id} still follows {found[0].words} ({found[0].rms_ug:.3g} µg rms, "
                f"{found[0].sigmas:.2g} sigma), which the noise of the others hid when the model "
                f"was selected: its coefficients are wrong by more than their sigmas; compare "
                f"the quiet runs without the noisy ones"
            )
