"""Doubts about a fit in words, a sentence each."""

from collections.abc import Iterator, Sequence

from accelbench.shell.console import number
from thermo.compensation.model_file import inside_of
from thermo.fitting.fit import AccelerometerFit
from thermo.uncertainty.by_position import by_position_sentence
from thermo.uncertainty.left_out import left_out_sentence
from thermo.uncertainty.not_shown import not_shown_sentence

# Of what may differ from run to run: factor to the unit, the unit, and in what.
UNITS = {
    "k0": (1e6, "µg", "K0"),
    "k1": (1e6, "ppm", "K1"),
    "temp_c": (1.0, "°C", "the thermistor's temperature"),
}
EVEN_ODDS = 0.5
FEW_RUNS = 3  # may agree by chance though runs differ: with two, one in ten times


def doubt_sentences(one: AccelerometerFit) -> Iterator[str]:
    """Tell what is to be doubted of an accelerometer's fit.

    Yields
    ------
    str
        One sentence for each: extrapolation, gaps, an odd run, what the residual follows, errors
        that the sigmas had to allow for, what cannot be had and where it is instead.
    """
    yield from _extrapolated(one)
    yield from _gaps(one)
    yield from _odd(one)
    if one.doubts.left_out:
        yield left_out_sentence(one.doubts.left_out)
    if one.doubts.by_position:
        yield by_position_sentence(one.doubts.by_position)
    yield from one.doubts.noise_sentences
    yield from _lost(one)
    if one.doubts.temperature_noise_counts:
        yield (
            f"the thermistor's noise of {number(one.doubts.thermistor_noise_c, 2)} °C is not "
            f"small compared with this range: it reduces slopes; the sigmas include this"
        )
    if one.doubts.output_step_counts:
        yield (
            f"the output goes in steps of {number(one.doubts.output_step_ug, 3)} µg, coarser than "
            "its noise: errors repeat at each visit to a position; the sigmas include this"
        )
    if one.heldout is None and len(one.channel.run_ids) > 1 and not one.heldout_runs:
        yield "no run can be held out: the other runs alone do not determine every coefficient"


def not_shown_lines(fits: Sequence[AccelerometerFit]) -> Iterator[str]:
    """Tell what a test cannot show, once for all accelerometers of which it is the same."""
    alike: dict[str, list[str]] = {}
    for one in fits:
        alike.setdefault(not_shown_sentence(one.doubts.not_shown), []).append(one.serial)
    for told, serials in alike.items():
        if told:
            yield told if len(alike) == 1 else f"{', '.join(serials)}: {told}"


def _extrapolated(one: AccelerometerFit) -> Iterator[str]:
    inside = inside_of(one)
    if inside is None:
        return
    low, high = one.valid_c
    away = max(low - one.t_ref_c, one.t_ref_c - high)
    told = ", ".join(
        f"{name} {number(v['value'], 7)} ± {number(v['sigma'], 2)} {v['unit']}"
        for name, v in inside["coefficients"].items()
        if name in ("k0", "k1", "k0_t1", "k1_t1")
    )
    yield (
        f"the reference temperature {one.t_ref_c:g} °C lies {number(away, 3)} °C outside the "
        f"readings ({number(low)} to {number(high)} °C): the coefficients are extrapolated, and "
        f"their sigmas include orders that these readings do not show; at {inside['t_ref_c']:g} "
        f"°C, "
        f"inside: {told}"
    )


def _gaps(one: AccelerometerFit) -> Iterator[str]:
    gaps = one.support.gaps_c
    if not gaps:
        return
    where = ", ".join(f"{number(a, 3)} to {number(b, 3)} °C" for a, b in gaps)
    yield (
        f"no reading from {where}: the polynomials are not determined there; the sigmas include "
        f"orders that would not be seen, and compensate flags readings there"
    )


def _odd(one: AccelerometerFit) -> Iterator[str]:
    odd = one.doubts.odd_run
    if odd is None:
        return
    factor, unit, what = UNITS[odd.name]
    yield (
        f"run {odd.run_id} lies apart from the others, by {number(factor * odd.off, 3)} ± "
        f"{number(factor * odd.sigma, 2)} {unit} in {what}: check it, or leave it out"
    )


def _lost(one: AccelerometerFit) -> Iterator[str]:
    lost = one.selection.not_separable if one.selection else ()
    if not lost:
        return
    zero = [n for n in lost if n != "k1"]
    parts = [f"{', '.join(zero)}, each taken as 0"] if zero else []
    parts += ["k1, taken as nominal"] if "k1" in lost else []
    holders = [f"{n} in {', '.join(by)}" for n, by in one.doubts.holders.items() if by]
    where = f"; other coefficients absorb them: {'; '.join(holders)}" if holders else ""
    yield f"these runs cannot determine: {'; '.join(parts)}{where}"


def run_to_run_sentence(one: AccelerometerFit) -> str:
    """Tell by how much runs differ, and whether the sigmas know it."""
    count = len(one.channel.run_ids)
    if count < 2:
        return (
            "one run: the differences between runs are not known, and the sigmas do not include "
            "them"
        )
    shown = [e for e in one.run_effects if e.odds > EVEN_ODDS and e.likely > 0]
    if not shown:
        chance = ", which may be by chance with so few runs" if count <= FEW_RUNS else ""
        return (
            f"the {count} runs do not differ by more than noise and drift{chance}; the sigmas "
            f"include differences that noise and drift could hide"
        )
    told = ", ".join(
        f"{number(UNITS[e.name][0] * e.likely, 2)} {UNITS[e.name][1]} in {UNITS[e.name][2]}"
        for e in shown
    )
    return (
        f"the {count} runs differ by {told} (1 sigma) beyond noise and drift; the sigmas include "
        f"this and its uncertainty from so few runs"
    )
