"""A fit told: as the JSON of `accelbench fit`, and in words."""

from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import RenderableType

from accelbench.commands.fit.doubts import (
    UNITS,
    doubt_sentences,
    not_shown_lines,
    run_to_run_sentence,
)
from accelbench.shell.console import micro_g, number, table, value_and_sigma
from accelbench.shell.tables import TextTable
from thermo.compensation.model_file import ModelFile, inside_of, reported, run_to_run_of
from thermo.fitting.findings import LoopFinding, find_loop, find_order
from thermo.fitting.fit import AccelerometerFit
from thermo.selection.residuals import ResidualGroup
from thermo.uncertainty.by_position import ByPosition

COLUMNS_ABREAST = 4  # accelerometers in one table of coefficients


def fit_document(fits: Sequence[AccelerometerFit], model: ModelFile) -> dict[str, Any]:
    """Return what `fit --json` writes.

    Parameters
    ----------
    fits : sequence of AccelerometerFit
    model : ModelFile
        Made of the same fits.

    Returns
    -------
    dict
    """
    return {
        "model_id": model.model_id,
        "equation": model.equation,
        "accelerometers": [_accelerometer(one) for one in fits],
    }


def _accelerometer(one: AccelerometerFit) -> dict[str, Any]:
    channel, summary, heldout = one.channel, one.summary, one.heldout
    order, loop, noise = find_order(one), find_loop(one), one.noise
    return {
        "serial": one.serial,
        "t_ref_c": one.t_ref_c,
        "valid_c": list(one.valid_c),
        "valid_rate_c_per_min": list(one.valid_rate_c_per_min),
        "coefficients": reported(one.fit, channel.nominal_scale, channel.output_unit),
        "residual_raw_ug": one.raw.rms_ug,
        "residual_ug": summary.rms_ug,
        "heldout_residual_ug": heldout.rms_ug if heldout else None,
        "heldout_sigma_ug": one.heldout_sigma_ug,
        "heldout_runs": list(one.heldout_runs),
        "heating_minus_cooling_ug": loop.median_ug,
        "heating_minus_cooling_sigma_ug": one.doubts.loop_sigma_ug,
        "heating_minus_cooling_at_40c_ug": loop.at_40c_ug,
        "heating_minus_cooling_by_run_ug": dict(loop.by_run_ug),
        "heating_minus_cooling_curve": [
            {"temp_c": c.temp_c, "ug": c.heating_minus_cooling_ug} for c in summary.loop
        ],
        "thermal_history_left": loop.stands_out and loop.repeats is not False,
        "loop_sentence": loop.sentence,
        "n_samples": one.fit.n,
        "k0_order": one.selection.k0_order if one.selection else None,
        "k1_order": one.selection.k1_order if one.selection else None,
        "higher_order_helps": order.helps,
        "order_sentence": order.sentence,
        "orders": _orders(one),
        "not_separable": list(one.selection.not_separable) if one.selection else [],
        "input_known": channel.has_input,
        "noise": {
            "white_ug": 1e6 * noise.white,
            "drift_ug": 1e6 * noise.drift,
            "drift_tau_s": noise.drift_tau_s,
        },
        "by_run": _groups(summary.by_run),
        "by_direction": _groups(summary.by_direction),
        "by_position": _groups(summary.by_position),
        "heldout_by_run": _groups(heldout.by_run) if heldout else [],
        "head_arcsec": one.head_arcsec,
        "condition": one.fit.condition,
        **_doubts(one),
        "source_runs": dict(one.digests),
    }


def _doubts(one: AccelerometerFit) -> dict[str, Any]:
    """Return what the coefficients and their sigmas do not say by themselves."""
    doubts = one.doubts
    odd = doubts.odd_run
    return {
        "own_scale": one.own_scale,
        "run_to_run": run_to_run_of(one),
        "run_to_run_likely": {e.name: e.likely * UNITS[e.name][0] for e in one.run_effects},
        "odd_run": odd.run_id if odd else None,
        "inside": inside_of(one),
        "gaps_c": [list(gap) for gap in one.support.gaps_c],
        "left_out": [
            {"name": f.name, "follows": f.words, "rms_ug": f.rms_ug, "sigmas": f.sigmas}
            for f in doubts.left_out
        ],
        "not_shown": [
            {"name": n.name, "effect": n.words, "stands_in": list(n.stands_in)}
            for n in doubts.not_shown
        ],
        "follows_position": _followed(doubts.by_position),
        "thermistor_noise_c": doubts.thermistor_noise_c,
        "output_step_ug": doubts.output_step_ug,
        "warnings": list(doubt_sentences(one)),
    }


def _followed(found: ByPosition | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "over_temperature": found.over_temperature,
        "rms_ug": found.rms_ug,
        "sigmas": found.sigmas,
        "positions": [{"name": name, "mean_ug": ug} for name, ug in found.positions],
        "alone": list(found.alone),
    }


def _orders(one: AccelerometerFit) -> list[dict[str, float]]:
    trials = one.selection.trials if one.selection else ()
    return [
        {
            "k0_order": t.k0_order,
            "k1_order": t.k1_order,
            "residual_ug": t.residual_ug,
            "heldout_ug": t.heldout_ug,
        }
        for t in trials
    ]


def _groups(groups: Sequence[ResidualGroup]) -> list[dict[str, Any]]:
    return [{"name": g.name, "n": g.n, "mean_ug": g.mean_ug, "rms_ug": g.rms_ug} for g in groups]


def fit_text(fits: Sequence[AccelerometerFit], model: ModelFile) -> Iterator[RenderableType]:
    """Tell fits in words and tables."""
    yield from summary_part(fits)
    for one in fits:
        yield f"{one.serial}: {one.fit.n} readings in {len(one.channel.run_ids)} run(s)"
        for line in fit_sentences(one):
            yield f"  {line}"
        yield ""
    for line in not_shown_lines(fits):
        yield line
        yield ""
    for first in range(0, len(fits), COLUMNS_ABREAST):
        yield _coefficients(fits[first : first + COLUMNS_ABREAST])
        yield ""
    yield f"model {model.model_id}: {model.equation}"


def summary_part(fits: Sequence[AccelerometerFit]) -> Iterator[RenderableType]:
    """Yield the small table that says how it went."""
    names = ("raw µg", "compensated µg", "held out µg", "heating − cooling µg")
    small = table("serial", *names, right=names)
    for one in fits:
        small.add_row(
            one.serial,
            number(one.raw.rms_ug),
            number(one.summary.rms_ug),
            number(one.heldout.rms_ug if one.heldout else None),
            number(one.summary.heating_minus_cooling_ug, 3),
        )
    yield small
    yield ""


def fit_sentences(one: AccelerometerFit) -> Iterator[str]:
    """Tell one accelerometer's fit, a sentence a line.

    Yields
    ------
    str
        Residuals before and after, orders, heating minus cooling, what cannot be separated, and
        what the numbers alone do not say.
    """
    yield (
        f"residual {micro_g(one.raw.rms_ug)} with constants only, "
        f"{micro_g(one.summary.rms_ug)} with the model{_heldout(one)}"
    )
    order, loop = find_order(one), find_loop(one)
    yield order.sentence
    yield _loop_line(one, loop)
    if loop.sentence:
        yield loop.sentence
    if not one.channel.has_input:
        yield (
            "the input is not recorded and taken as constant: K0 and its slopes over temperature "
            "include the input and the effects of K1, k2, k3 and the misalignment at this input; "
            "they compensate readings at this input only"
        )
    yield from doubt_sentences(one)
    noise = one.noise
    drift = (
        f" and {number(1e6 * noise.drift, 3)} µg of drift correlated over "
        f"{number(noise.drift_tau_s / 3600, 2)} h"
        if noise.drift
        else ", no visible drift"
    )
    head = f", and for a head wrong by {number(one.head_arcsec)} arcsec" if one.head_arcsec else ""
    white = number(1e6 * noise.white, 3)
    yield f"noise {white} µg a reading{drift}; the sigmas include both{head}{_repeating(one)}"
    yield run_to_run_sentence(one)
    lo, hi = one.valid_c
    yield f"valid from {number(lo)} to {number(hi)} °C; reference temperature {one.t_ref_c:g} °C"


def _repeating(one: AccelerometerFit) -> str:
    """Tell what repeats in all runs, shows in no residual and was not stated."""
    channel = one.channel
    stated = {
        "the head's angle (head_arcsec)": one.head_arcsec or not channel.has_input,
        "the thermistor's offset (temp_sigma_c)": channel.temp_sigma_c,
        "its gain (temp_gain_ppm)": channel.temp_gain_ppm,
    }
    unsaid = [what for what, there in stated.items() if not there]
    if not unsaid:
        return ""
    return f", but not errors that are equal in all runs and were not stated: {', '.join(unsaid)}"


def _heldout(one: AccelerometerFit) -> str:
    if one.heldout is None:
        return ""
    which = ", ".join(one.heldout_runs) or "each run predicted from the others"
    sigma = one.heldout_sigma_ug
    about = f" ± {number(sigma, 2)}" if sigma is not None else ""
    return f", {micro_g(one.heldout.rms_ug)}{about} on runs not fitted ({which})"


def _loop_line(one: AccelerometerFit, loop: LoopFinding) -> str:
    if loop.median_ug is None:
        return _one_way_line(one)
    sigma = one.doubts.loop_sigma_ug
    about = f" (sigma {number(sigma, 2)} µg)" if sigma is not None else ""
    parts = [f"{_both_units(one, loop.median_ug)}{about} in the median over temperature"]
    if loop.at_40c_ug is not None:
        parts.append(f"{_both_units(one, loop.at_40c_ug)} at 40 °C")
    return f"heating minus cooling: {', '.join(parts)}"


def _one_way_line(one: AccelerometerFit) -> str:
    plain = "heating minus cooling: not available, because the runs have one direction only"
    if not one.doubts.one_way:
        return plain
    costs = ", ".join(
        f"{words} K0 by {number(k0, 2)} µg and K1 by {number(k1, 2)} ppm"
        for words, k0, k1 in one.doubts.one_way
    )
    return (
        f"{plain}; effects of the direction or of time are then absorbed by the coefficients, "
        f"and the sigmas do not include them: here {costs}"
    )


def _both_units(one: AccelerometerFit, value_ug: float) -> str:
    text = micro_g(value_ug)
    if one.channel.output_unit == "m/s2":
        text += f" = {number(1e-6 * value_ug * one.channel.gravity_m_s2, 3)} m/s²"
    return text


def _coefficients(fits: Sequence[AccelerometerFit]) -> TextTable:
    """Return a table of coefficients: value ± sigma, an accelerometer a column."""
    serials = [f.serial for f in fits]
    made = table("coefficient", "unit", *serials, right=serials, keys=2)
    of_each = [reported(f.fit, f.channel.nominal_scale, f.channel.output_unit) for f in fits]
    names = dict.fromkeys(name for values in of_each for name in values)
    for name in names:
        unit = next(str(values[name]["unit"]) for values in of_each if name in values)
        cells = [
            value_and_sigma(float(v[name]["value"]), float(v[name]["sigma"])) if name in v else "–"
            for v in of_each
        ]
        made.add_row(name, unit, *cells)
    return made
