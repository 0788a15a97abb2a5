"""The effect without a name: a shape of one quantity for what repeats and no library explains.

Every quantity that is recorded is tried, plain and multiplied by what may go with it (the input,
the direction of the ramp, temperature, the sign of the last turn); the likeliest is taken, and kept
if it predicts runs that it was not made from.
"""

from collections.abc import Generator, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.gate import Judgement
from errormodel.discrepancy.measurement import Revision
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.ranking import chi_square
from errormodel.discrepancy.search.state import SearchState
from errormodel.discrepancy.shape import (
    Formula,
    Shape,
    best_formula,
    fit_shape,
    knots_of,
)
from errormodel.errors import NotSeparableError
from errormodel.io.python_file import LibrarySource
from errormodel.noise.model import NoiseModel
from errormodel.terms import Effect, Term
from thermo.discrepancy.factors import Seen, kinds_in
from thermo.discrepancy.held_out import HeldOut, RunGap, gap_of_all, gap_of_run
from thermo.discrepancy.problem.source import ThermalSource
from thermo.library import term, thermal_library, using_thermal_library
from thermo.library.effects import ThermalEffect
from thermo.library.quantities import QUANTITIES
from thermo.library.shape import TIMES, factor_values, quantity_of, shape_effect, shape_term
from thermo.recording.signals import Signal

# Twice the log-likelihood that a further factor of a product, or no formula, must be worth.
PRICE = 9.0
# A shape is kept where it takes away this share of the mean square that runs held out show.
PREDICTS = 0.02
# What a name costs, beside its parameters: as where several are weighed against one.
PER_NAME, PER_PARAMETER = 10.0, 2.0
NAMED_SHARE = 0.5  # of what repeats, that names must explain to stand beside a shape
# Quantities that no shape is made of: they belong to these runs.
OF_THESE_RUNS = frozenset({"run", "time", "rest_before_run", "direction", "hour_of_day"})
# In runs of one programme everything that repeats is a function of these: they are no rivals of a
# name, and a shape of them is made only of what has none.
OF_THE_PROGRAMME = frozenset({"time_in_run", "since_ramp_change", "turned_at"})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pattern:
    """A quantity, what its function is multiplied by, and the function."""

    quantity: str
    times: str
    shape: Shape

    def effect(self, name: str, sentence: str = "") -> ThermalEffect:
        """Return the effect that it is."""
        return shape_effect(name, sentence, self.shape.size.tolist())

    def term(self, name: str, sentence: str = "") -> Term:
        """Return the term that it is."""
        return shape_term(
            name,
            self.quantity,
            self.shape.knots.tolist(),
            self.shape.curves.tolist(),
            times=self.times,
            sentence=sentence,
        )

    @contextmanager
    def in_library(self, name: str, sentence: str = "") -> Generator[None]:
        """Have its term in the library until the end of the block."""
        made = self.term(name, sentence)
        source = LibrarySource(name=name, sha256="", members=frozenset([name]))
        known = thermal_library()
        terms = {n: make for n, make in known.terms.items() if n != name}
        wider = replace(known, terms=terms).with_members({name: lambda: made}, [], source)
        with using_thermal_library(wider):
            yield

    def source_with(self, source: ThermalSource, name: str) -> ThermalSource:
        """Return a source whose library has the effect too."""
        return ThermalSource(source.channel, source.model, (*source.effects, self.effect(name)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShapeFound:
    """An effect without a name, and what it does on runs held out.

    Attributes
    ----------
    name : str
    pattern : Pattern
    formula : Formula or None
        A short formula that explains as much.
    sentence : str
    choices : tuple of Choice
        The effects beside it, and it.
    heldout : HeldOut
    """

    name: str
    pattern: Pattern
    formula: Formula | None
    sentence: str
    choices: tuple[Choice, ...]
    heldout: HeldOut

    @property
    def peak_ug(self) -> float:
        """Half the range of its function."""
        return 0.5 * float(np.ptp(self.pattern.shape.values))

    def in_library(self) -> AbstractContextManager[None]:
        """Have its term in the library until the end of a block."""
        return self.pattern.in_library(self.name, self.sentence)

    def source_with(self, source: ThermalSource) -> ThermalSource:
        """Return a source whose library has the effect too."""
        return self.pattern.source_with(source, self.name)


def against_shape(
    source: ThermalSource, judgement: Judgement, result: SearchState, name: str
) -> Revision:
    """Hold the names found against a shape in the place of the last of them, and beside them.

    A name costs as much as a shape's curve does for each of its parameters, and what a further
    effect must explain; so does the shape. The shape is taken only where it is clearly better and
    predicts runs held out.

    Parameters
    ----------
    source : ThermalSource
    judgement : Judgement
    result : SearchState
    name : str
        Name that the shape will have.

    Returns
    -------
    Revision
        The names that are left, and the `ShapeFound` as their rival where there is one.
    """
    kept = Revision(judgement, result)
    if source.seen.runs < 2 or judgement.verdict in ("nothing", "unexplained_noise"):
        return kept
    noise, price = result.floor.noise, result.rules.further
    slots = sorted(result.slots, key=lambda s: -s.gain)
    alone = chi_square(result.view(()))
    best: tuple[float, int, float, Pattern] | None = None
    for count in range(len(slots) + 1):
        beside = tuple(s.choice for s in slots[:count])
        pattern = likeliest_pattern(source, beside, noise, rivals=judgement.names_stand)
        if pattern is None:
            continue
        explained = alone - chi_square(result.view(beside))
        score = explained - _cost(source, beside) + pattern.shape.score - price
        if best is None or score > best[0]:
            best = (score, count, explained, pattern)
    names_alone = result.explained - _cost(source, result.found)
    if best is None or best[0] < (names_alone if judgement.names_stand else 0.0) + PRICE:
        return kept
    _, count, explained, pattern = best
    beside = tuple(s.choice for s in slots[:count])
    found = find_shape(source, beside, noise, pattern, name)
    if found is None:
        return kept
    share = explained / (explained + pattern.shape.gain)
    stands = judgement.names_stand and share >= NAMED_SHARE
    verdict = judgement.verdict if stands else "unexplained_repeatable"
    left = replace(result, slots=tuple(slots[:count]), explained=explained)
    judgement = replace(judgement, verdict=verdict, explained_share=share, loud=True)
    return Revision(judgement, left, found)


def _cost(source: ThermalSource, chosen: Sequence[Choice]) -> float:
    """Return the chi-square that names must explain to be worth it."""
    terms = [term(n) for c in chosen for n in source.form_of(c).terms]
    parameters = sum(len(t.parameters) + _coefficients(t) for t in terms)
    return PER_PARAMETER * parameters + PER_NAME * len(chosen)


def _coefficients(one: Effect) -> int:
    return len(one.coefficients) if isinstance(one, Term) else 0


def find_shape(
    source: ThermalSource,
    beside: Sequence[Choice],
    noise: NoiseModel,
    pattern: Pattern,
    name: str,
) -> ShapeFound | None:
    """Return a pattern as an effect, if it predicts held-out runs.

    Parameters
    ----------
    source : ThermalSource
    beside : sequence of Choice
        Effects of the library that are in the model.
    noise : NoiseModel
    pattern : Pattern
    name : str
        The effect's.
    """
    choices = (*beside, Choice(name, ()))
    gaps: list[RunGap] = []
    for run in source.channel.run_ids:
        gap = _gap_without(source, run, beside, noise, pattern, name)
        if gap is None:
            return None
        gaps.append(gap)
    heldout = gap_of_all(gaps, source, beside)
    if heldout is None or heldout.after_ug**2 > (1.0 - PREDICTS) * heldout.before_ug**2:
        return None
    view = View(source.problem(tuple(beside), noise), noise)
    x, times = factor_by_block(source.seen, pattern.quantity, pattern.times)
    formula = best_formula(view, x, times)
    if formula is not None and not _as_good(formula, pattern.shape):
        formula = None
    return ShapeFound(
        name=name,
        pattern=pattern,
        formula=formula,
        sentence=_sentence(pattern, formula),
        choices=choices,
        heldout=heldout,
    )


def likeliest_pattern(
    source: ThermalSource, beside: Sequence[Choice], noise: NoiseModel, *, rivals: bool = False
) -> Pattern | None:
    """Return the likeliest function of a quantity; the plain one unless a product is clearly.

    Parameters
    ----------
    source : ThermalSource
    beside : sequence of Choice
        Effects in the model.
    noise : NoiseModel
    rivals : bool
        Only of quantities that are not the programme's.
    """
    view = View(source.problem(tuple(beside), noise), noise)
    found: list[tuple[float, Pattern]] = []
    for quantity, times in _trials(source.seen):
        if rivals and quantity in OF_THE_PROGRAMME:
            continue
        x, by = factor_by_block(source.seen, quantity, times)
        shape = fit_shape(view, x, by, knots_of(x))
        if shape is not None:
            score = 2.0 * shape.evidence - (PRICE if times else 0.0)
            found.append((score, Pattern(quantity=quantity, times=times, shape=shape)))
    return max(found, key=lambda one: one[0])[1] if found else None


def _gap_without(
    source: ThermalSource,
    run: str,
    beside: Sequence[Choice],
    noise: NoiseModel,
    pattern: Pattern,
    name: str,
) -> RunGap | None:
    """Predict a run by the shape that the others give; None where they cannot give the model."""
    channel = source.channel
    kept = tuple(r for r in channel.run_ids if r != run)
    seen = channel.take(channel.runs_mask(kept))
    try:
        others = ThermalSource(seen, source.model, source.effects)
        view = View(others.problem(tuple(beside), noise), noise)
        x, by = factor_by_block(others.seen, pattern.quantity, pattern.times)
        shape = fit_shape(view, x, by, pattern.shape.knots)
        if shape is None:
            return gap_of_run(source, run, others, beside)
        of_others = replace(pattern, shape=shape)
        with of_others.in_library(name):
            larger = of_others.source_with(others, name)
            return gap_of_run(source, run, larger, (*beside, Choice(name, ())))
    except (NotSeparableError, np.linalg.LinAlgError):
        return None


def _trials(seen: Seen) -> Iterator[tuple[str, str]]:
    names = [k.quantity.name for k in kinds_in(seen) if k.quantity.name not in OF_THESE_RUNS]
    signals = seen.channel.record.signals
    for name in names:
        for times in TIMES:
            if times == name or (times == "input" and not seen.has_input):
                continue
            if times in QUANTITIES and not QUANTITIES[times].needs <= set(signals):
                continue
            yield name, times


def factor_by_block(seen: Seen, quantity: str, times: str) -> tuple[FloatArray, FloatArray]:
    """Return a quantity by block, and what its function is multiplied by."""
    x = seen.of(quantity_of(quantity))
    if times == "input":
        return x, seen.blocks.mean(seen.channel.record["a_i_g"])
    if not times:
        return x, np.ones(x.size)
    return x, factor_values(times, seen.of(QUANTITIES[times]))


def _as_good(formula: Formula, shape: Shape) -> bool:
    """Tell whether a formula explains as much as a shape, each after two for a parameter."""
    saved = 2.0 * (shape.size.size - formula.parameters)
    return shape.gain - formula.gain < max(PRICE, 0.05 * shape.gain) + saved


TIMES_WORDS = {
    "": "",
    "input": ", in proportion to the input",
    "direction": ", with the sign of heating or cooling",
    "temperature": ", in proportion to the temperature",
    "last_move": ", with the sign of the head's last turn",
}


def _sentence(pattern: Pattern, formula: Formula | None) -> str:
    """Say what the effect does."""
    quantity = quantity_of(pattern.quantity)
    unit = "ppm" if pattern.times == "input" else "µg"
    peak = 0.5 * float(np.ptp(pattern.shape.values))
    text = f"An effect without a name: {peak:.2g} {unit}"
    if formula is not None and formula.family == "sine":
        text += f" with a period of {formula.at:.3g} {quantity.unit}".rstrip()
    return f"{text}; it {quantity.words}{TIMES_WORDS[pattern.times]}."


def formula_words(found: ShapeFound) -> str | None:
    """Return the short formula in words, with what it loses; None without one."""
    formula = found.formula
    if formula is None:
        return None
    quantity = quantity_of(found.pattern.quantity)
    at = f"{formula.at:.3g} {quantity.unit}".rstrip()
    words = {
        "power": f"a power of {formula.at:.0f}",
        "exponential": f"an exponential with a constant of {at}",
        "sine": f"a sine with a period of {at}",
        "kink": f"a kink at {at}",
        "step": f"a step at {at}",
    }[formula.family]
    return (
        f"{words} explains as much with {formula.parameters} parameters, but for "
        f"{100.0 * lost_share(found):.1f} %"
    )


def lost_share(found: ShapeFound) -> float:
    """Return the share of what a shape explains that its short formula does not; 0 without one."""
    if found.formula is None:
        return 0.0
    return max(0.0, 1.0 - found.formula.gain / found.pattern.shape.gain)


def library_text(shapes: Sequence[ShapeFound], columns: Sequence[Signal] = ()) -> str:
    """Return a library file of shapes, for `--library`.

    Parameters
    ----------
    shapes : sequence of ShapeFound
    columns : sequence of Signal
        Recorded columns that no other file declares.
    """
    lines = [
        '"""Effects without a name, found in measurements: give this file by --library."""',
        "",
        "from thermo.library.shape import shape_effect, shape_term",
    ]
    if columns:
        lines.append("from thermo.recording.signals import Signal")
    for one in shapes:
        shape = one.pattern.shape
        upper = one.name.upper()
        lines += ["", f"# {one.sentence}", f"{upper}_KNOTS = {_numbers(shape.knots)}"]
        lines += [f"{upper}_CURVES = ["]
        lines += [f"    {_numbers(curve)}," for curve in shape.curves]
        lines += [
            "]",
            "",
            "",
            f"def {one.name}():",
            "    return shape_term(",
            f"        {one.name!r}, {one.pattern.quantity!r}, {upper}_KNOTS, {upper}_CURVES,",
            f"        times={one.pattern.times!r},",
            f"        sentence={one.sentence!r},",
            "    )",
            "",
        ]
    lines += [
        "",
        f"TERMS = {{{', '.join(f'{o.name!r}: {o.name}' for o in shapes)}}}",
        "EFFECTS = [",
    ]
    lines += [
        f"    shape_effect({o.name!r}, {o.sentence!r}, {_numbers(o.pattern.shape.size)}),"
        for o in shapes
    ]
    lines += ["]"]
    if columns:
        lines += ["SIGNALS = ["]
        lines += [
            f"    Signal(name={c.name!r}, unit={c.unit!r}, sentence={c.sentence!r}, recorded=True),"
            for c in columns
        ]
        lines += ["]"]
    return "\n".join(lines) + "\n"


def _numbers(values: FloatArray) -> str:
    return "[" + ", ".join(f"{v:.6g}" for v in values.tolist()) + "]"
