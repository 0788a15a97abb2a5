"""The report: one HTML file that holds everything, and its figures as PNG beside it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from accelbench.commands.fit.doubts import not_shown_lines
from accelbench.commands.fit.figures import MAX_ACCELEROMETERS, pictures
from accelbench.commands.fit.text import fit_sentences
from accelbench.shell.console import micro_g, number, value_and_sigma
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import (
    SOURCE_COLUMNS,
    Banner,
    Page,
    ReportTable,
    Section,
    measured_on,
    render_page,
    source_rows,
)
from errormodel.io.atomic import write_files
from thermo.compensation.model_file import CLIP_RULE, ModelFile, make_model_file, reported
from thermo.fitting.findings import find_loop
from thermo.fitting.fit import AccelerometerFit
from thermo.recording.files import RecordedRuns
from thermo.uncertainty.by_position import by_position_sentence
from thermo.uncertainty.left_out import left_out_sentence

USE = "Use the model within the temperatures and rates it is valid for."
SEARCH = "Use the model with care; `accelbench discrepancy thermal` names what is missing from it."
REPLACE = "Do not use the model; check the recording's positions, unit and scale, and fit again."
MEANINGS = {
    "k0": "bias",
    "k1": "scale factor",
    "k2": "second order",
    "k3": "third order",
    "delta_o": "misalignment about OA",
    "delta_p": "misalignment about PA",
    "k_ip": "cross-coupling of IA and PA",
    "k_io": "cross-coupling of IA and OA",
}
ABREAST = 3  # accelerometers in one table of coefficients: what a sheet of A4 takes
SUMMARY_COLUMNS = (
    "serial", "constants only", "with the model", "on runs not fitted", "heating − cooling",
    "better by", "readings",
)  # fmt: skip

CONVENTIONS = (
    "Specific force of a body at rest points up with magnitude g; a is in local g.",
    "IA is the input, PA the pendulous, OA the output axis, OA = IA × PA; with the indexing head "
    "at θ, a_i = sin θ, a_p = cos θ, a_o = 0.",
    "Measured = true + error; a residual is the measured minus the modelled output, referred to "
    "the input.",
    "Heating minus cooling is the difference of the mean residuals at equal temperature, its "
    "median over the temperatures of both directions.",
    "Sigmas are standard deviations (1 σ). They include white noise, slow drift, and the "
    "differences between runs if there are two or more.",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportExtras:
    """Additions to a report beside the fits: the model file, further tables, further sentences."""

    model: ModelFile | None = None
    tables: tuple[ReportTable, ...] = ()
    notes: tuple[str, ...] = ()


def write_report(
    fits: Sequence[AccelerometerFit],
    runs: RecordedRuns,
    directory: Path,
    *,
    title: str,
    extras: ReportExtras | None = None,
) -> Path:
    """Write a report and its figures.

    Parameters
    ----------
    fits : sequence of AccelerometerFit
    runs : RecordedRuns
        What was fitted.
    directory : Path
        Made when it is not there; files of the same names are replaced.
    title : str
    extras : ReportExtras, optional

    Returns
    -------
    Path
        The HTML file; it refers to nothing outside itself.

    Raises
    ------
    InputError
        If a file cannot be written; then none was.
    """
    files = render_report(fits, runs, title=title, extras=extras)
    write_files([(directory / name, content) for name, content in files.items()])
    return directory / REPORT_NAME


def render_report(
    fits: Sequence[AccelerometerFit],
    runs: RecordedRuns,
    *,
    title: str,
    extras: ReportExtras | None = None,
) -> dict[str, bytes]:
    """Return a report's files by name, without writing any."""
    extras = extras or ReportExtras()
    model = extras.model or make_model_file(fits)
    sections = (
        *_results(fits, extras),
        *_coefficient_sections(fits, model),
        *_closing(fits, runs),
    )
    page = Page(
        title=title,
        verdicts=tuple(verdicts(fits)),
        sections=sections,
        about=f"model {model.model_id}",
        measured=measured_on(runs),
        made_by=f"Model file format {model.format} {model.format_version}, made by "
        f"{model.software}.",
    )
    return render_page(page, REPORT_NAME)


def verdicts(fits: Sequence[AccelerometerFit]) -> Iterator[Banner]:
    """Yield what there is to say first: a box for each finding, one for all without any."""
    sound: list[str] = []
    for one in fits:
        found = list(findings(one))
        if found:
            state = "bad" if one.worse_than_none else "open"
            todo = REPLACE if one.worse_than_none else SEARCH
            yield Banner(text=f"{one.serial}: {'; '.join(found)}", state=state, todo=todo)
        else:
            sound.append(one.serial)
    if sound:
        yield Banner(
            text=f"{', '.join(sound)}: no structure is seen in the residual", state="good", todo=USE
        )


def findings(one: AccelerometerFit) -> Iterator[str]:
    """Yield what the residual of an accelerometer's model shows, if it shows anything."""
    if one.worse_than_none:
        yield (
            "the residual with the model is larger than with constants alone: the model does "
            "not describe these readings"
        )
    loop = find_loop(one)
    if loop.stands_out and loop.repeats is not False and loop.median_ug is not None:
        yield (
            f"a thermal-history effect is left, heating less cooling {micro_g(loop.median_ug)}, "
            "which no polynomial in temperature can describe"
        )
    if one.doubts.left_out:
        yield left_out_sentence(one.doubts.left_out)
    if one.doubts.by_position:
        yield by_position_sentence(one.doubts.by_position)
    if one.doubts.odd_run is not None:
        yield f"run {one.doubts.odd_run.run_id} lies apart from the others"


def _results(fits: Sequence[AccelerometerFit], extras: ReportExtras) -> Iterator[Section]:
    yield Section(
        title="Result",
        tables=(
            ReportTable(
                columns=SUMMARY_COLUMNS,
                rows=tuple(_summary(fits)),
                note="Residuals are rms over readings, referred to the input.",
            ),
        ),
        after=extras.notes,
    )
    for one in fits:
        yield Section(title=one.serial, level=3, points=tuple(fit_sentences(one)))
    yield Section(lines=tuple(not_shown_lines(fits)))
    for extra in extras.tables:
        words = tuple(range(len(extra.columns)))
        yield Section(title=extra.title, tables=(extra,), words=words)


def _coefficient_sections(fits: Sequence[AccelerometerFit], model: ModelFile) -> Iterator[Section]:
    tables = tuple(
        ReportTable(
            columns=("coefficient", "of", "unit", *(f.serial for f in some)),
            rows=tuple(_coefficients(some)),
        )
        for some in (fits[k : k + ABREAST] for k in range(0, len(fits), ABREAST))
    )
    yield Section(
        title="Coefficients",
        tables=tables,
        words=(0, 1, 2),
        after=(model.equation, f"{CLIP_RULE[0].upper()}{CLIP_RULE[1:]}."),
    )


def _closing(fits: Sequence[AccelerometerFit], runs: RecordedRuns) -> Iterator[Section]:
    unpictured = len(fits) - MAX_ACCELEROMETERS
    told = f"{unpictured} further accelerometers have no figures of their own; they are in the "
    yield Section(
        title="Figures",
        lines=(f"{told}tables.",) if unpictured > 0 else (),
        pictures=tuple(pictures(fits, runs)),
    )
    fitted = {run for f in fits for run in f.digests}
    rows = tuple(source_rows(runs, fitted))
    yield Section(
        title="Sources",
        tables=(ReportTable(columns=SOURCE_COLUMNS, rows=rows),),
        words=(0, 1, 2, 5),
    )
    yield Section(title="Conventions", points=CONVENTIONS)


def _summary(fits: Sequence[AccelerometerFit]) -> Iterator[tuple[str, ...]]:
    for f in fits:
        yield (
            f.serial,
            micro_g(f.raw.rms_ug),
            micro_g(f.summary.rms_ug),
            micro_g(f.heldout.rms_ug if f.heldout else None),
            micro_g(f.summary.heating_minus_cooling_ug),
            _factor(f),
            f"{f.fit.n}",
        )


def _factor(one: AccelerometerFit) -> str:
    return f"{one.raw.rms_ug / one.summary.rms_ug:.3g} ×" if one.summary.rms_ug else "–"


def meaning(name: str) -> str:
    """Return what a coefficient of the model is of, in words; empty if its name is not known."""
    stem, _, order = name.partition("_t")
    words = MEANINGS.get(stem, "")
    if not (words and order):
        return words
    return f"{words}, by temperature" + (f" to the power {order}" if order != "1" else "")


def _coefficients(fits: Sequence[AccelerometerFit]) -> list[tuple[str, ...]]:
    of_each = [reported(f.fit, f.channel.nominal_scale, f.channel.output_unit) for f in fits]
    rows: list[tuple[str, ...]] = []
    for name in dict.fromkeys(name for values in of_each for name in values):
        unit = next(str(v[name]["unit"]) for v in of_each if name in v)
        cells = [
            value_and_sigma(float(v[name]["value"]), float(v[name]["sigma"])) if name in v else "–"
            for v in of_each
        ]
        rows.append((name, meaning(name), unit, *cells))
    noises = [f.noise for f in fits]
    rows.append(("white noise", "", "µg", *(number(1e6 * n.white, 3) for n in noises)))
    rows.append(("drift", "", "µg", *(number(1e6 * n.drift, 3) for n in noises)))
    hours = (number(n.drift_tau_s / 3600, 2) if n.drift else "–" for n in noises)
    rows.append(("drift correlated over", "", "h", *hours))
    rows.append(("T_ref", "", "°C", *(number(f.t_ref_c) for f in fits)))
    rows.append(("valid for temperatures", "", "°C", *(_range(f.valid_c) for f in fits)))
    rates = (_range(f.valid_rate_c_per_min) for f in fits)
    rows.append(("valid for rates", "", "°C/min", *rates))
    return rows


def _range(pair: tuple[float, float]) -> str:
    return f"{number(pair[0], 3)} … {number(pair[1], 3)}"
