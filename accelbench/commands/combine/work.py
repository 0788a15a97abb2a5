"""`accelbench combine`: a SINS calibrated on the rig with its accelerometers' chamber models."""

from collections.abc import Sequence
from pathlib import Path

from accelbench.commands.combine.text import combined_text
from accelbench.commands.rig_calibrate.options import asked_groups
from accelbench.joint.chambers import chamber_model, three_serials
from accelbench.joint.combined import combine_and_judge
from accelbench.joint.result_file import CombinedResult
from accelbench.shell.outputs import (
    Results,
    check_results,
    with_sidecars,
)
from accelbench.shell.progress import working
from accelbench.shell.surroundings import show_warnings_at_once
from sinscal.combination.combine import Combination
from sinscal.judgement.judge import Judged
from sinscal.judgement.result_file import dump_result
from sinscal.model.chamber import ChamberModel
from sinscal.model.priors import read_priors
from sinscal.recording.files import read_rig_run
from sinscal.recording.run import RigRun
from thermo.compensation.model_file import ModelFile, read_model

FAILED = 1
STEPS = 4  # calibrations and a flight, each told


def combine(
    thermal: Path,
    rig: Path,
    accelerometers: str | None,
    mode: str,
    groups: tuple[str, ...],
    priors: Path | None,
    turn_on_ug: float,
    turn_on_ppm: float,
    out: Path | None,
    report: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Carry out `accelbench combine`; the arguments are its options."""
    inputs = [thermal, *with_sidecars([rig]), *([priors] if priors else [])]
    check_results(out, report, inputs, force=force)
    asked = asked_groups(groups)
    chambers = _chambers(read_model(thermal), accelerometers)
    known = read_priors(priors) if priors else None
    run = read_rig_run(rig)
    show_warnings_at_once()
    with working("combining", steps=STEPS) as work:
        made, judged, result = combine_and_judge(
            run,
            chambers,
            "precise" if mode == "precise" else "coarse",
            groups=asked,
            priors=known,
            turn_on={"k0": 1e-6 * turn_on_ug, "k1": 1e-6 * turn_on_ppm},
            tell=work.tell,
        )
    results = Results(result.model_dump(mode="json"), list(combined_text(result)))
    results.add_file("result file", out, lambda: dump_result(result))
    results.add_report(report, lambda: _pages(made, judged, run, chambers, result))
    results.write(as_json=as_json)
    failed = bool(made.test.contradictions) or not made.calibration.converged
    return FAILED if failed else 0


def _pages(
    made: Combination,
    judged: Judged,
    run: RigRun,
    chambers: Sequence[ChamberModel],
    result: CombinedResult,
) -> dict[str, bytes]:
    from accelbench.commands.combine.page import render_combined  # matplotlib takes its second

    return render_combined(made, judged, run, chambers, result)


def _chambers(model: ModelFile, asked: str | None) -> list[ChamberModel]:
    """Return the chamber models of x, y, z."""
    names = asked or ",".join(a.serial for a in model.accelerometers)
    serials = three_serials(names)
    return [chamber_model(model.of(serial)) for serial in serials]
