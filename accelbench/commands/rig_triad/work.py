"""`accelbench rig triad`: an accelerometer triad from rests in many positions."""

import json
from pathlib import Path

import click

from accelbench.commands.rig_triad.text import render_triad, triad_document, triad_text
from accelbench.shell.outputs import Results, check_results
from errormodel.io.tables import sidecar_path
from sinscal.triad.rests import (
    Rests,
    Unit,
    calibrate_at_rest,
    rests_of_log,
    rests_of_means,
    rests_of_run,
)


def triad(
    file: Path,
    columns: str | None,
    gravity: float | None,
    rate_hz: float | None,
    time_column: str | None,
    unit: Unit,
    means: bool,
    sigma: float | None,
    form: str,
    temperature: bool,
    out: Path | None,
    report: Path | None,
    trust_units: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Carry out `accelbench triad`; the arguments are its options."""
    check_results(out, report, [file, sidecar_path(file)], force=force)
    if sigma is not None and not means:
        raise click.UsageError("--sigma requires --means")
    if means:
        if rate_hz is not None or time_column is not None:
            raise click.UsageError("--rate-hz and --time-column are not allowed with --means")
        names, g = _three(columns, gravity)
        rests = rests_of_means(file, names, gravity_m_s2=g, unit=unit, sigma=sigma or 0.0)
    else:
        rests = _rests(file, columns, gravity, rate_hz, time_column, unit)
    done = calibrate_at_rest(
        rests,
        gauge="upper" if form == "upper" else "lower",
        with_temperature=temperature,
        trust_units=trust_units,
    )
    results = Results(triad_document(done), [*triad_text(done), *done.doubts])
    results.add_file("written", out, lambda: json.dumps(results.document, indent=2) + "\n")
    results.add_report(report, lambda: render_triad(done))
    results.write(as_json=as_json)
    return 1 if done.doubts else 0


def _three(columns: str | None, gravity: float | None) -> tuple[tuple[str, str, str], float]:
    if columns is None:
        raise click.UsageError("--means needs --columns X,Y,Z")
    names = tuple(name.strip() for name in columns.split(","))
    if len(names) != 3:
        raise click.UsageError(f"--columns {columns}: expected three, like 2,3,4")
    if gravity is None:
        raise click.UsageError("--columns needs --gravity, m/s²")
    _check_gravity(gravity)
    return (names[0], names[1], names[2]), gravity


def _check_gravity(gravity: float | None) -> None:
    if gravity is not None and not 9.7 < gravity < 9.9:
        raise click.UsageError(f"--gravity {gravity:g}: expected 9.7 to 9.9 m/s²")


def _rests(
    file: Path,
    columns: str | None,
    gravity: float | None,
    rate_hz: float | None,
    time_column: str | None,
    unit: Unit,
) -> Rests:
    _check_gravity(gravity)
    if columns is None:
        if rate_hz is not None or time_column is not None:
            raise click.UsageError("--rate-hz and --time-column require --columns")
        return rests_of_run(file, gravity)
    names, g = _three(columns, gravity)
    if (rate_hz is None) == (time_column is None):
        raise click.UsageError("--columns needs either --rate-hz or --time-column")
    if rate_hz is not None and not 1.0 <= rate_hz <= 1e5:
        raise click.UsageError(f"--rate-hz {rate_hz:g}: expected 1 to 100000")
    return rests_of_log(
        file,
        names,
        gravity_m_s2=g,
        step_s=None if rate_hz is None else 1.0 / rate_hz,
        time_column=time_column,
        unit=unit,
    )
