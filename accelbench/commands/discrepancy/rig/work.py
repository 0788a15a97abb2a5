"""`accelbench discrepancy rig`: the effect that the rig filter's model lacks."""

from pathlib import Path

from accelbench.commands.discrepancy.options import tell
from accelbench.commands.discrepancy.rig.text import enlarged, rig_document, rig_text
from accelbench.shell.outputs import Results, check_results, with_sidecars
from sinscal.discrepancy.find import RigDiscrepancy, find_rig_discrepancy
from sinscal.library import rig_library
from sinscal.model.larger_model import read_rig_model, rig_model_toml
from sinscal.recording.files import read_rig_run
from sinscal.recording.join import join_rig_runs
from sinscal.recording.run import RigRun


def discrepancy_rig(
    files: tuple[Path, ...],
    model: Path | None,
    out: Path | None,
    report: Path | None,
    seed: int,
    force: bool,
    as_json: bool,
) -> None:
    """Carry out `accelbench discrepancy rig`; the arguments are its options."""
    inputs = [*with_sidecars(list(files)), *([model] if model else [])]
    check_results(out, report, inputs, force=force)
    present = read_rig_model(model) if model else None
    run = join_rig_runs([read_rig_run(f) for f in files])
    found = find_rig_discrepancy(run, present=present, seed=seed, tell=tell)
    results = Results(rig_document(found), list(rig_text(found)))
    results.add_file("larger model", out, lambda: _larger_model(found))
    results.add_report(report, lambda: _pages(found, run))
    results.write(as_json=as_json)


def _larger_model(found: RigDiscrepancy) -> str:
    sentences = {e.name: e.sentence for e in rig_library().effects}
    return rig_model_toml(enlarged(found), sentences)


def _pages(found: RigDiscrepancy, run: RigRun) -> dict[str, bytes]:
    from accelbench.commands.discrepancy.rig.page import (
        render_rig_discrepancy,  # matplotlib takes its second
    )

    return render_rig_discrepancy(found, run)
