"""A triad calibrated at rest, for JSON, for people and as a report."""

from collections.abc import Iterator

import numpy as np
from rich.console import RenderableType
from scipy import stats

from accelbench.shell.console import number, table, value_and_sigma
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import Banner, Page, ReportTable, Section, render_page
from errormodel.arrays import rms
from sinscal.recording.run import AXES
from sinscal.triad.rests import RestCalibration
from sinscal.triad.triad import errors_of

FORMULA = "f = T·K·(a − b), m/s²; K = diag(scale), T unit triangular with the misalignments"
SHOWN = 3  # rows told of
WITH_TEMPERATURE = "; b + bias_t·(T − T_ref) for b, K·(1 + scale_t·(T − T_ref)) for K"


def triad_document(done: RestCalibration) -> dict[str, object]:
    """Return the result for JSON."""
    fit, found = done.fit, done.intervals
    left_out = [
        {"position": one.position + 1, "residual_m_s2": one.residual_m_s2, "sigmas": one.sigmas}
        for one in fit.left_out
    ]
    return {
        "parameters": {
            name: {"value": value, "sigma": sigma, "unit": parameter_unit(name, done.rests.unit)}
            for name, value, sigma in zip(
                fit.names, fit.values.tolist(), fit.sigmas.tolist(), strict=True
            )
        },
        "names": list(fit.names),
        "covariance": fit.cov.tolist(),
        "formula": triad_formula(done),
        "matrix": fit.model.matrix.tolist(),
        "bias": fit.model.bias.tolist(),
        "errors": _errors(done),
        "form": fit.model.gauge,
        "unit": done.rests.unit,
        "gravity_m_s2": fit.gravity_m_s2,
        "t_ref_c": fit.t_ref_c,
        "rms_before_m_s2": rms(done.before_m_s2[fit.used]),
        "rms_after_m_s2": fit.rms_m_s2,
        "between_positions_m_s2": fit.pose_m_s2,
        "chi2": fit.chi2,
        "dof": fit.dof,
        "p_value": float(stats.chi2.sf(fit.chi2, fit.dof)) if fit.dof else None,
        "singular_values": fit.singular_values.tolist(),
        "noise": found.noise[:3].tolist(),
        "step_s": found.step_s,
        "rest_s": found.rest_s,
        "total_s": found.total_s,
        "too_short": found.too_short,
        "left_out": left_out,
        "digit": found.digit[:3].tolist(),
        "digit_sigma": found.digit_sigma[:3].tolist(),
        "readings": {
            "total": len(done.rests.accel),
            "left_out": {"outlier": done.left_out.size} if done.left_out.size else {},
        },
        "doubtful_units": list(done.doubts),
        "positions": [
            {
                "first_row": int(a) + 1,
                "last_row": int(b) + 1,
                "residual_m_s2": float(r),
                "used": bool(k in fit.used),
            }
            for k, (a, b, r) in enumerate(
                zip(found.first, found.last, fit.residual_m_s2, strict=True)
            )
        ],
    }


def parameter_unit(name: str, unit: str) -> str:
    """Return the unit of a parameter, for readings in `unit`."""
    of_kind = (
        ("scale_t", "1/°C"),
        ("bias_t", f"{unit}/°C"),
        ("scale", f"(m/s2)/({unit})"),
        ("bias", unit),
    )
    return {f"{kind}_{a}": shown for kind, shown in of_kind for a in AXES}.get(name, "rad")


def triad_formula(done: RestCalibration) -> str:
    """Say how the result is applied."""
    return FORMULA + ("" if done.fit.t_ref_c is None else WITH_TEMPERATURE)


def triad_text(done: RestCalibration) -> Iterator[RenderableType]:
    """Say the same for people."""
    fit, found = done.fit, done.intervals
    where = "given" if done.rests.mean_sigma is not None else f"at rest in {found.total_s:.0f} s"
    yield (
        f"{len(found)} positions {where}, {fit.used.size} fitted; "
        f"gravity {fit.gravity_m_s2:.5f} m/s²"
    )
    made = table("parameter", "value", "unit", right=("value",))
    for name, value, sigma in zip(fit.names, fit.values, fit.sigmas, strict=True):
        made.add_row(name, value_and_sigma(value, sigma), parameter_unit(name, done.rests.unit))
    yield made
    yield f"apply: {triad_formula(done)}; {fit.model.gauge} form"
    yield from triad_sentences(done)


def triad_sentences(done: RestCalibration) -> Iterator[str]:
    """Say what the fit is worth."""
    fit = done.fit
    before, after = 1e3 * rms(done.before_m_s2[fit.used]), 1e3 * fit.rms_m_s2
    yield f"|f| − g: {number(before)} mm/s² rms before, {number(after)} mm/s² after"
    p = stats.chi2.sf(fit.chi2, fit.dof) if fit.dof else 1.0
    said = (
        f"scatter from position to position of {number(1e3 * fit.pose_m_s2, 3)} mm/s² is "
        f"included in the sigmas"
        if fit.pose_m_s2 > 0
        else "the noise of the rows explains it"
    )
    alone = f"χ² with the noise of the rows alone {number(fit.chi2)} for {fit.dof} (p {p:.2g})"
    yield f"{alone}: {said}"
    coarse = done.intervals.digit_sigma[:3]
    if coarse.any():
        yield (
            f"the readings go in steps of {number(float(done.intervals.digit[:3].max()), 3)} "
            f"{done.rests.unit}, coarser than their noise: a position's mean is known to "
            f"{number(float(coarse.max()), 2)} {done.rests.unit}, which is included in the sigmas"
        )
    if done.left_out.size:
        shown = ", ".join(str(row + 1) for row in done.left_out[:SHOWN].tolist())
        more = f" and {done.left_out.size - SHOWN} more" if done.left_out.size > SHOWN else ""
        yield (
            f"{done.left_out.size} readings left out, which deviate from their neighbours and "
            f"return: row {shown}{more}"
        )
    for one in fit.left_out:
        yield (
            f"left out: position {one.position + 1}, |f| − g of "
            f"{number(1e3 * one.residual_m_s2, 3)} mm/s², {one.sigmas:.1f} sigmas"
        )


def render_triad(done: RestCalibration) -> dict[str, bytes]:
    """Return the report's files by name."""
    from accelbench.commands.rig_triad.figures import draw_triad  # matplotlib takes its second

    fit = done.fit
    rows = tuple(
        (name, value_and_sigma(value, sigma), parameter_unit(name, done.rests.unit))
        for name, value, sigma in zip(fit.names, fit.values, fit.sigmas, strict=True)
    )
    parameters = ReportTable(
        title="Parameters", columns=("parameter", "value ± 1 σ", "unit"), rows=rows
    )
    picture = draw_triad(done)
    first, *_ = triad_sentences(done)
    page = Page(
        title="Accelerometer triad from positions at rest",
        verdicts=(Banner(text=first, state="open" if done.doubts else ""),),
        sections=(
            Section(title="Result", points=tuple(triad_sentences(done)), pictures=(picture,)),
            Section(
                title="Parameters",
                table=parameters,
                words=(0, 2),
                lines=(f"{triad_formula(done)}. {fit.model.gauge.capitalize()} form.",),
            ),
        ),
    )
    return render_page(page, REPORT_NAME)


def _errors(done: RestCalibration) -> dict[str, object] | None:
    """Return f′ = (I + Γ)f + Δf⁰ where readings are in m/s² and Γ is lower triangular."""
    if done.rests.unit != "m/s2" or done.fit.model.gauge != "lower":
        return None
    names, values, cov = errors_of(done.fit)
    biases = {f"accel_bias_{a}" for a in AXES}
    return {
        name: {
            "value": float(value),
            "sigma": float(sigma),
            "unit": "m/s2" if name in biases else "1",
        }
        for name, value, sigma in zip(names, values, np.sqrt(np.diag(cov)), strict=True)
    }
