"""`accelbench discrepancy rig`: the effect that the rig filter's model lacks."""

from pathlib import Path

import click

from accelbench.commands.discrepancy.rig_text import enlarged, rig_document, rig_text
from accelbench.shell.console import emit
from accelbench.shell.outputs import (
    REPORT_NAME,
    check_results,
    with_sidecars,
)
from errormodel.io.atomic import write_files
from sinscal.discrepancy.find import find_rig_discrepancy
from sinscal.library import rig_library
from sinscal.model.larger_model import read_rig_model, rig_model_toml
from sinscal.recording.files import read_rig_run
from sinscal.recording.join import join_runs


def discrepancy_rig(
    files: tuple[Path, ...],
    model: Path | None,
    out: Path | None,
    report: Path | None,
    *,
    seed: int,
    force: bool,
    as_json: bool,
) -> None:
    """Search the innovations of the rig filter, over cycles that follow one another."""
    inputs = [*with_sidecars(list(files)), *([model] if model else [])]
    check_results(out, report, inputs, force=force)
    present = read_rig_model(model) if model else None
    run = join_runs([read_rig_run(f) for f in files])
    found = find_rig_discrepancy(run, present=present, seed=seed, tell=_tell)
    document, text = rig_document(found), list(rig_text(found))
    written: list[tuple[Path, bytes]] = []
    if out is not None:
        sentences = {e.name: e.sentence for e in rig_library().effects}
        written.append((out, rig_model_toml(enlarged(found), sentences).encode()))
        document["out"] = str(out)
        text.append(f"larger model: {out}")
    if report is not None:
        from accelbench.commands.discrepancy.rig_page import (
            render_rig_discrepancy,  # matplotlib: a second
        )

        pages = render_rig_discrepancy(found, run)
        written += [(report / name, content) for name, content in pages.items()]
        document["report"] = str(report / REPORT_NAME)
        text.append(f"report: {report / REPORT_NAME}")
    write_files(written)
    emit(document, text, as_json=as_json)


def _tell(line: str) -> None:
    click.echo(line, err=True)
