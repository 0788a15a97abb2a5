"""The search: one effect after another, each slot tried again once the others are known."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.coloured import NoiseShape
from errormodel.discrepancy.floor import NoiseFloor, estimate_floor
from errormodel.discrepancy.nulls import Calibration
from errormodel.discrepancy.problem import Candidate, Problem, Signature, Theta
from errormodel.discrepancy.scan import Found, Prepared, View


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """The thresholds, frozen before any benchmark is run.

    Attributes
    ----------
    alpha : float
        False-alarm rate of the library as a whole, for an effect to enter.
    alpha_rest : float
        The same for what is left to be called unexplained.
    alias : float
        Effects whose gain (beyond its mean under the null) is within this of the best cannot be
        told from it. Two effects that truly differ by this in expectation are taken for each
        other in about one case in 700.
    share : float
        What the named effects must explain of the excess for their names to stand.
    supple : float
        A more supple member of a family must gain this, beyond twice its further unknowns.
    relative : float
        An effect weaker than this share of a named one, in a pattern that the named one half
        imitates, is told as the shape of that one and not by a name of its own.
    most : int
        Effects named at most.
    """

    alpha: float = 0.006
    alpha_rest: float = 0.004
    alias: float = 9.0
    share: float = 0.6
    supple: float = 9.0
    relative: float = 0.15
    most: int = 3


@dataclass(frozen=True, slots=True)
class Choice:
    """An effect put into the model, at its nonlinear parameters; `rich` the supple member."""

    name: str
    theta: Theta
    rich: bool = False


class Source(Protocol):
    """What makes the engine's problem of a model with some effects added."""

    def problem(self, chosen: Sequence[Choice], shape: NoiseShape) -> Problem:
        """Return the problem of the enlarged model, refitted under a noise."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearSource:
    """A source for a problem that is linear in everything, as a filter's innovations are.

    The effects chosen join the baseline by their signature's columns.
    """

    start: Problem

    def problem(self, chosen: Sequence[Choice], shape: NoiseShape) -> Problem:
        """Return the problem with the chosen effects' columns in the baseline."""
        del shape
        by_name = {c.name: c for c in self.start.candidates}
        added = [by_name[c.name].signature(c.theta).columns for c in chosen]
        names = {c.name for c in chosen}
        return Problem(
            times=self.start.times,
            residual=self.start.residual,
            base=np.hstack([self.start.base, *added]),
            candidates=tuple(c for c in self.start.candidates if c.name not in names),
            saturated=np.hstack([self.start.saturated, *added]),
            factors=self.start.factors,
            noise=self.start.noise,
            sigma=self.start.sigma,
            events=self.start.events,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Slot:
    """One named effect and its rivals.

    Attributes
    ----------
    choice : Choice
    gain : float
        Chi-square it explains beside the other effects.
    p_value : float
        Of that gain, over the library.
    rivals : tuple of (str, float)
        Every other effect with how far its score lies below, nearest first.
    alias : tuple of str
        The names that cannot be told apart, the best first; one name alone: it is named.
    """

    choice: Choice
    gain: float
    p_value: float
    rivals: tuple[tuple[str, float], ...]
    alias: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SearchResult:
    """What the search found.

    Attributes
    ----------
    slots : tuple of Slot
    floor : NoiseFloor
        The noise the last steps were judged by.
    explained : float
        Chi-square that the effects explain together.
    first : tuple of Found
        Every candidate on the residual of the present model.
    """

    slots: tuple[Slot, ...]
    floor: NoiseFloor
    explained: float
    first: tuple[Found, ...] = field(default=())


def chi_square(view: View) -> float:
    """Return the whitened sum of squares that the baseline leaves."""
    rest = view.beside_base(view.data[:, None])[:, 0]
    return float(rest @ rest)


class Search:
    """A search for missing effects under one calibration."""

    def __init__(
        self, source: Source, floor: NoiseFloor, laws: Calibration, rules: Rules | None = None
    ) -> None:
        self.source, self.floor, self.laws = source, floor, laws
        self.rules = rules or Rules()

    def view(self, chosen: Sequence[Choice]) -> View:
        """Return the refitted problem under the present noise."""
        problem = self.source.problem(chosen, self.floor.shape)
        return View(problem, self.floor.shape, self.floor.sigma)

    def chosen(self) -> tuple[Choice, ...]:
        """Add effects while they are significant."""
        return tuple(self._added()[0])

    def _added(self) -> tuple[list[Choice], tuple[Found, ...]]:
        chosen: list[Choice] = []
        first: tuple[Found, ...] = ()
        for _ in range(self.rules.most):
            view = self.view(chosen)
            ranked = self._entrants(self.ranked(view), chosen)
            first = first or tuple(f for f, _ in ranked)
            if not ranked or not self._enters(ranked[0][0]):
                break
            best = ranked[0][0]
            if chosen and self._is_shape(best, view, chosen):
                break
            chosen.append(Choice(best.candidate.name, best.theta))
            chosen = self._made_supple(chosen)
            if best.candidate.event and view.problem.noise is None:
                self._renew_floor(chosen)
        return chosen, first

    def run(self) -> SearchResult:
        """Add effects while they are significant, then try every slot again."""
        chosen, first = self._added()
        slots = self._settled(chosen)
        explained = 0.0
        if slots:
            before, after = self.view([]), self.view([s.choice for s in slots])
            explained = chi_square(before) - chi_square(after)
        return SearchResult(slots=slots, floor=self.floor, explained=explained, first=first)

    def ranked(self, view: View) -> list[tuple[Found, float]]:
        """Return every candidate at its best with its score, best first.

        The score is the gain beyond its mean under the null: what an effect with more unknowns
        gains by luck does not count for it.
        """
        found = Prepared(view, view.problem.candidates).scan()
        scored = [(f, f.gain - self._luck(f.candidate.name)) for f in found]
        return sorted(scored, key=lambda s: -s[1])

    def _entrants(
        self, ranked: list[tuple[Found, float]], chosen: Sequence[Choice]
    ) -> list[tuple[Found, float]]:
        """Let events count with their likelihood ratio, which the first effect alone has."""
        if chosen or not self.laws.ratios:
            return ranked
        made = [
            (f, self.laws.ratios[n] - self._luck(n) if n in self.laws.ratios else score)
            for f, score in ranked
            for n in (f.candidate.name,)
        ]
        return sorted(made, key=lambda s: -s[1])

    def _luck(self, name: str) -> float:
        return self.laws.gains[name].mean if name in self.laws.gains else 0.0

    def p_value(self, found: Found) -> float:
        """Return the p-value of a candidate's gain over the whole library."""
        name = found.candidate.name
        gain = max(found.grid_gain, self.laws.ratios.get(name, 0.0))
        return self.laws.p_family(self.laws.p_of(name, gain))

    def _enters(self, best: Found) -> bool:
        return self.p_value(best) < self.rules.alpha

    def _is_shape(self, best: Found, view: View, chosen: Sequence[Choice]) -> bool:
        """Tell whether an effect is only the ill-known shape of a much stronger one."""
        plain = self.view([])
        signature = best.candidate.signature(best.theta)
        alone, beside = plain.strength(signature), view.strength(signature)
        imitated = 1.0 - (beside / alone) ** 2 if alone > 0 else 1.0
        total = chi_square(plain) - chi_square(view)
        return imitated > 0.3 and best.gain < self.rules.relative**2 * total and bool(chosen)

    def _made_supple(self, chosen: list[Choice]) -> list[Choice]:
        """Give the last effect its family's richer member when that explains clearly more."""
        last = chosen[-1]
        view = self.view(chosen[:-1])
        head = next(c for c in view.problem.candidates if c.name == last.name)
        if head.richer is None:
            return chosen
        plain = Prepared(view, [head]).scan()[0]
        rich = Prepared(view, [head.richer]).scan()[0]
        more = _unknowns(head.richer) - _unknowns(head)
        if rich.gain - plain.gain > self.rules.supple + 2.0 * more:
            return [*chosen[:-1], Choice(last.name, rich.theta, rich=True)]
        return chosen

    def _renew_floor(self, chosen: Sequence[Choice]) -> None:
        problem = self.source.problem(chosen, self.floor.shape)
        saturated = np.hstack([problem.saturated, problem.base])
        self.floor = estimate_floor(problem.times, problem.residual, saturated)

    def _settled(self, chosen: list[Choice]) -> tuple[Slot, ...]:
        """Try every slot again beside the others; drop what no longer stands."""
        for _ in range(2):
            slots: list[Slot] = []
            moved = False
            for k in range(len(chosen)):
                others = [c for j, c in enumerate(chosen) if j != k]
                slot = self._slot(others, chosen[k])
                if slot is None:
                    return self._settled(others)
                moved |= slot.choice.name != chosen[k].name
                chosen[k] = slot.choice
                slots.append(slot)
            if not moved:
                return tuple(slots)
        return tuple(slots) if chosen else ()

    def _slot(self, others: Sequence[Choice], present: Choice) -> Slot | None:
        view = self.view(others)
        ranked = self._with_rich(view, self.ranked(view), present)
        (best, top) = ranked[0]
        if not self._enters(best):
            return None
        rivals = tuple((f.candidate.name, top - score) for f, score in ranked[1:])
        alias = [f.candidate.name for f, score in ranked if top - score < self.rules.alias]
        rich = present.rich and best.candidate.name == present.name
        return Slot(
            choice=Choice(best.candidate.name, best.theta, rich=rich),
            gain=best.gain,
            p_value=self.p_value(best),
            rivals=rivals,
            alias=tuple(alias),
        )

    def _with_rich(
        self, view: View, ranked: list[tuple[Found, float]], present: Choice
    ) -> list[tuple[Found, float]]:
        """Let the richer member stand for its family where it was chosen."""
        if not present.rich:
            return ranked
        made: list[tuple[Found, float]] = []
        for found, score in ranked:
            candidate = found.candidate
            if candidate.name == present.name and candidate.richer is not None:
                rich = Prepared(view, [candidate.richer]).scan()[0]
                more = _unknowns(candidate.richer) - _unknowns(candidate)
                better = rich.gain - found.gain - 2.0 * more
                if better > 0:
                    kept = Found(
                        candidate=candidate,
                        theta=rich.theta,
                        gain=rich.gain,
                        grid_gain=max(found.grid_gain, rich.grid_gain),
                    )
                    made.append((kept, score + better))
                    continue
            made.append((found, score))
        return sorted(made, key=lambda s: -s[1])


def _unknowns(candidate: Candidate) -> int:
    signature: Signature = candidate.prepared()[0]
    return signature.columns.shape[1] + len(candidate.grid[0])


def residual_of(view: View) -> FloatArray:
    """Return the whitened residual beside the baseline."""
    return view.beside_base(view.data[:, None])[:, 0]
