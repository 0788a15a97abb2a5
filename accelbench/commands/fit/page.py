"""The report: one HTML file that holds everything, and its figures as PNG beside it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from accelbench.commands.fit.doubts import not_shown_lines
from accelbench.commands.fit.figures import MAX_ACCELEROMETERS, pictures
from accelbench.commands.fit.text import sentences
from accelbench.shell.console import micro_g, number, value_and_sigma
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import ReportTable, embedded, rendered, source_rows
from errormodel.io.atomic import write_files
from thermo.compensation.model_file import CLIP_RULE, ModelFile, make_model_file, reported
from thermo.fitting.fit import AccelerometerFit
from thermo.recording.files import RecordedRuns

CONVENTIONS = (
    "Specific force of a body at rest points up with magnitude g; a is in local g.",
    "IA is the input, PA the pendulous, OA the output axis, OA = IA × PA; with the indexing head "
    "at θ, a_i = sin θ, a_p = cos θ, a_o = 0.",
    "Measured = true + error; a residual is the measured output less the model's, referred to the "
    "input.",
    "Heating minus cooling is the difference of the mean residuals at equal temperature, its "
    "median taken over the temperatures that both directions passed.",
    "Sigmas are standard deviations (1 σ) and allow for slow drift as well as for white noise, and "
    "for what differs from run to run where there are two or more.",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportExtras:
    """What a report says besides the fits: the model file, further tables, further sentences."""

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
    drawn = list(pictures(fits, runs))
    html = rendered(
        "report.html.j2",
        title=title,
        model=extras.model or make_model_file(fits),
        clip_rule=CLIP_RULE,
        summary=_summary(fits),
        told=[(f.serial, list(sentences(f))) for f in fits],
        not_shown=list(not_shown_lines(fits)),
        coefficients=_coefficients(fits),
        sources=source_rows(runs, {run for f in fits for run in f.digests}),
        conventions=CONVENTIONS,
        figures=[embedded(p) for p in drawn],
        unpictured=max(0, len(fits) - MAX_ACCELEROMETERS),
        extras=extras,
    )
    return {REPORT_NAME: html.encode(), **{p.name: p.png for p in drawn}}


def _summary(fits: Sequence[AccelerometerFit]) -> list[list[str]]:
    return [
        [
            f.serial,
            micro_g(f.raw.rms_ug),
            micro_g(f.summary.rms_ug),
            micro_g(f.heldout.rms_ug if f.heldout else None),
            micro_g(f.summary.heating_minus_cooling_ug),
            _factor(f),
            f"{f.fit.n}",
        ]
        for f in fits
    ]


def _factor(one: AccelerometerFit) -> str:
    return f"{one.raw.rms_ug / one.summary.rms_ug:.3g} ×" if one.summary.rms_ug else "–"


def _coefficients(fits: Sequence[AccelerometerFit]) -> list[list[str]]:
    of_each = [reported(f.fit, f.channel.nominal_scale, f.channel.output_unit) for f in fits]
    rows: list[list[str]] = []
    for name in dict.fromkeys(name for values in of_each for name in values):
        unit = next(str(v[name]["unit"]) for v in of_each if name in v)
        cells = [
            value_and_sigma(float(v[name]["value"]), float(v[name]["sigma"])) if name in v else "–"
            for v in of_each
        ]
        rows.append([name, unit, *cells])
    noises = [f.noise for f in fits]
    rows.append(["white noise", "µg", *(number(1e6 * n.white, 3) for n in noises)])
    rows.append(["drift", "µg", *(number(1e6 * n.drift, 3) for n in noises)])
    hours = (number(n.drift_tau_s / 3600, 2) if n.drift else "–" for n in noises)
    rows.append(["drift correlated over", "h", *hours])
    rows.append(["T_ref", "°C", *(number(f.t_ref_c) for f in fits)])
    rows.append(["valid from … to", "°C", *(_range(f.valid_c) for f in fits)])
    rates = (_range(f.valid_rate_c_per_min) for f in fits)
    rows.append(["valid from … to", "°C/min", *rates])
    return rows


def _range(pair: tuple[float, float]) -> str:
    return f"{number(pair[0], 3)} … {number(pair[1], 3)}"
