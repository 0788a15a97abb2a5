"""`accelbench rig calibrate` and `rig compensate`: a SINS's errors found, and taken out."""

from dataclasses import replace
from pathlib import Path

import click

from accelbench.commands.rig_calibrate.options import asked_groups, asked_limits
from accelbench.commands.rig_calibrate.text import calibration_document, calibration_text
from accelbench.joint.result_file import CombinedResult, read_calibration
from accelbench.shell.console import emit
from accelbench.shell.library import library_option
from accelbench.shell.outputs import (
    Results,
    check_results,
    checked_run_output,
    force_option,
    json_option,
    with_sidecars,
)
from accelbench.shell.surroundings import show_warnings_at_once
from errormodel.errors import InputError
from sinscal.calibration.hold_out import EACH, LAST, NONE, Held
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.judgement.judge import Judged, Options, calibrate_and_judge, judge_navigation
from sinscal.judgement.result_content import run_digest
from sinscal.judgement.result_file import RigResult, dump_result, make_result
from sinscal.model.chamber import within_range
from sinscal.model.compensate import compensate_run
from sinscal.model.larger_model import RigModelFile, read_rig_model
from sinscal.model.priors import read_priors
from sinscal.recording.files import compensated_with, read_nav_run, read_rig_run, write_rig_run
from sinscal.recording.join import join_runs
from sinscal.recording.run import NavRun, RigRun

FAILED = 1
NAVIGATION = "navigation"


def _held(ctx: click.Context, param: click.Parameter, value: str) -> Held:
    """Return which cycle to hold out, as a word or the cycle's number."""
    for word in (LAST, EACH, NONE):
        if value == word:
            return word
    if not value.isdecimal():
        said = f"{value!r}: expected a cycle's number, last, each or none"
        raise click.BadParameter(said, ctx, param)
    return int(value)


@click.command()
@click.argument("files", nargs=-1, required=True, type=Path, metavar="DATA.csv…")
@click.option(
    "--mode",
    type=click.Choice(["coarse", "precise", NAVIGATION]),
    help="Raw sensors; raw sensors and the rig's angle; navigation outputs. By default as --model "
    "says, else coarse.",
)
@click.option("--model", type=Path, help="MODEL.toml of discrepancy rig: estimate its terms too.")
@click.option(
    "--groups", multiple=True, metavar="NAME", help="Also estimate, e.g. lever_arm; repeatable."
)
@click.option("--priors", type=Path, help="PRIORS.toml: other sigmas and means beforehand.")
@click.option("--interval-s", type=click.FloatRange(0.05, 60.0), default=1.0,
              help="Between two measurements of the filter.")  # fmt: skip
@click.option("--gate", type=click.FloatRange(3.0, 100.0), default=7.0,
              help="Sigmas beyond which a measurement is refused.")  # fmt: skip
@click.option("--gyro-instability", type=click.FloatRange(min=0.0), default=0.0,
              help="Sigma of the gyros' slow drift, °/h.")  # fmt: skip
@click.option("--accel-instability", type=click.FloatRange(min=0.0), default=0.0,
              help="Sigma of the accelerometers' slow drift, m/s².")  # fmt: skip
@click.option("--instability-tau-s", type=click.FloatRange(min=1.0), default=3600.0,
              help="Correlation time of slow drift.")  # fmt: skip
@click.option("--axis-wobble", type=click.FloatRange(min=0.0, min_open=True),
              help="Bound of the rig axis's movement, ″/√Hz; the angle's noise if not given.",
              )  # fmt: skip
@click.option("--t-ref-c", type=float, help="Reference temperature: --model's, else 25.")
@click.option("--holdout", callback=_held, default=LAST, metavar="N|last|each|none",
              help="Cycle to judge by the others.")  # fmt: skip
@click.option("--protect", multiple=True, metavar="GROUP=LIMIT",
              help="Pass only when a missing effect that no test shows cannot make an error of the "
              "group larger than this (its protection level), e.g. gyro_bias=0.05, in the unit "
              "that the group is told in; repeatable.")  # fmt: skip
@click.option("--out", type=Path, help="RESULT.json to write.")
@click.option("--report", type=Path, help="Folder for the report and its figures.")
@force_option
@library_option()
@json_option
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
    """Calibrate a SINS from a run on a rig, and judge the result.

    Several files are cycles of one SINS that follow one another. Exit code 1 when the result is
    not consistent. In Python: accelbench.rig.calibrate.
    """
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
        return nav, judge_navigation(nav, options, _tell)
    run = join_runs([read_rig_run(path) for path in files])
    show_warnings_at_once()
    return run, calibrate_and_judge(run, options, _tell)


def _tell(text: str) -> None:
    click.echo(text, err=True)


def _report(judged: Judged, run: RigRun | NavRun, result: RigResult) -> dict[str, bytes]:
    from accelbench.commands.rig_calibrate.page import (
        render_calibration,  # matplotlib takes its second
    )

    return render_calibration(judged, run, result)


@click.command()
@click.argument("file", type=Path, metavar="DATA.csv")
@click.option(
    "--calibration", type=Path, required=True, help="RESULT.json of rig calibrate or combine."
)
@click.option("--out", type=Path, required=True, help="The compensated run to write.")
@force_option
@library_option()
@json_option
def compensate(file: Path, calibration: Path, out: Path, force: bool, as_json: bool) -> None:
    """Take the calibrated errors out of a rig run's readings.

    Flags, times and the rig's angle stay as they are. A jump that the calibration found is taken
    out of the run it was found in; in any other it is over. A run that is compensated already is
    refused. In Python: accelbench.rig.compensate.
    """
    checked_run_output(out, [*with_sidecars([file]), calibration], force=force)
    result = read_calibration(calibration)
    if not result.converged:
        raise InputError(calibration, "converged", "false: these values are not to be used")
    run = read_rig_run(file, physics=False)
    if (before := compensated_with(file)) is not None:
        raise InputError(file, "", f"is compensated already, with {before}")
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
