"""`accelbench rig calibrate` and `rig compensate`: a SINS's errors found, and taken out."""

from dataclasses import replace
from pathlib import Path

import click

from accelbench.commands.rig_calibrate.options import asked_groups, asked_limits
from accelbench.commands.rig_calibrate.text import calibration_document, calibration_text
from accelbench.joint.result_file import CombinedResult, read_calibration
from accelbench.shell.console import emit
from accelbench.shell.outputs import Results, check_results, checked_run_output, with_sidecars
from accelbench.shell.progress import working
from accelbench.shell.surroundings import show_warnings_at_once
from errormodel.errors import InputError
from sinscal.calibration.hold_out import Held
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.judgement.judge import Judged
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge, judge_navigation
from sinscal.judgement.result_content import run_digest
from sinscal.judgement.result_file import RigResult, dump_result, make_result
from sinscal.model.chamber import within_range
from sinscal.model.compensate import compensate_run
from sinscal.model.larger_model import RigModelFile, read_rig_model
from sinscal.model.priors import read_priors
from sinscal.recording.files import compensated_with, read_nav_run, read_rig_run, write_rig_run
from sinscal.recording.join import join_rig_runs
from sinscal.recording.run import NavRun, RigRun

FAILED = 1
NAVIGATION = "navigation"


def calibrate(
    files: tuple[Path, ...],
    mode: str | None,
    model: Path | None,
    groups: tuple[str, ...],
    priors: Path | None,
    interval_s: float,
    gate: float,
    gyro_instability: float,
    accel_instability: float,
    instability_tau_s: float,
    axis_wobble: float | None,
    t_ref_c: float | None,
    holdout: Held,
    protect: tuple[str, ...],
    out: Path | None,
    report: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Carry out `accelbench calibrate`; the arguments are its options."""
    inputs = [*with_sidecars(files), *(p for p in (priors, model) if p)]
    check_results(out, report, inputs, force=force)
    limits = asked_limits(protect)
    larger = read_rig_model(model) if model else RigModelFile()
    mode = mode or larger.mode
    options = Options(
        mode="precise" if mode == "precise" else "coarse",
        groups=(*larger.groups, *asked_groups(groups)),
        steps=larger.steps,
        priors=read_priors(priors) if priors else None,
        interval_s=interval_s,
        gate=gate,
        gyro_instability=gyro_instability * DEG_PER_H,
        accel_instability=accel_instability,
        instability_tau_s=instability_tau_s,
        wobble=None if axis_wobble is None else axis_wobble * ARCSEC,
        t_ref_c=larger.t_ref_c if t_ref_c is None else t_ref_c,
        hold_out=holdout,
        protect=limits,
    )
    run, judged = _calibrated(files, mode, options)
    result = make_result(judged, run)
    results = Results(calibration_document(result), list(calibration_text(result)))
    results.add_file("result file", out, lambda: dump_result(result))
    results.add_report(report, lambda: _report(judged, run, result))
    results.write(as_json=as_json)
    return 0 if judged.passed else FAILED


def _calibrated(
    files: tuple[Path, ...], mode: str, options: Options
) -> tuple[RigRun | NavRun, Judged]:
    if mode == NAVIGATION:
        first, *more = files
        if more:
            raise click.UsageError("--mode navigation takes one file")
        nav = read_nav_run(first)
        show_warnings_at_once()
        with working("calibrating") as work:
            return nav, judge_navigation(nav, options, work.tell)
    run = join_rig_runs([read_rig_run(path) for path in files])
    show_warnings_at_once()
    with working("calibrating") as work:
        return run, calibrate_and_judge(run, options, work.tell)


def _report(judged: Judged, run: RigRun | NavRun, result: RigResult) -> dict[str, bytes]:
    from accelbench.commands.rig_calibrate.page import (
        render_calibration,  # matplotlib takes its second
    )

    return render_calibration(judged, run, result)


def compensate(file: Path, calibration: Path, out: Path, force: bool, as_json: bool) -> None:
    """Carry out `accelbench compensate`; the arguments are its options."""
    checked_run_output(out, [*with_sidecars([file]), calibration], force=force)
    result = read_calibration(calibration)
    if not result.converged:
        raise InputError(calibration, "converged", "false: do not use these values")
    run = read_rig_run(file, physics=False)
    if (before := compensated_with(file)) is not None:
        raise InputError(file, "", f"is already compensated, with {before}")
    done = _compensated(run, result)
    write_rig_run(done, out, compensated_with=result.result_id)
    flagged = int((~(done.flag == 0)).sum()) if done.flag is not None else 0
    document = {
        "out": str(out),
        "calibration": result.result_id,
        "rows": len(done),
        "flagged": flagged,
        "warnings": list(done.warnings),
    }
    text = f"{out}: {len(done)} rows compensated with {result.result_id}, {flagged} of them flagged"
    emit(document, [text], as_json=as_json)


def _compensated(run: RigRun, result: RigResult | CombinedResult) -> RigRun:
    """Return the run compensated; its temperatures stay as measured."""
    if isinstance(result, RigResult):
        later = run_digest(run) != result.run.digest
        return compensate_run(run, result.sensors, result.values, later=later)
    done = compensate_run(within_range(run, result.valid_c), result.sensors, result.values)
    return replace(done, temp_c=run.temp_c)
