"""The search: one effect after another, each slot tried again once the others are known."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from errormodel.discrepancy.choices import Choice, Rules, SearchResult, Slot, Source
from errormodel.discrepancy.events import event_ratios, events_of, fixed, placed
from errormodel.discrepancy.nulls import Calibration
from errormodel.discrepancy.pairs import best_pair
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.ranking import (
    Ranked,
    chi_square,
    gain_of,
    lasting,
    simplest_first,
    unknowns_of,
)
from errormodel.discrepancy.scan import Found, Prepared, View
from errormodel.discrepancy.wander import over_wander
from errormodel.noise.floor import estimate_floor
from errormodel.noise.model import NoiseFit, NoiseModel

# Simulates the null laws anew once the noise has been estimated beside an event.
Recalibrate = Callable[[Problem, NoiseFit], Calibration]


class Search:
    """A search for missing effects under one calibration."""

    def __init__(
        self,
        source: Source,
        floor: NoiseFit,
        laws: Calibration,
        rules: Rules | None = None,
        again: Recalibrate | None = None,
        start: Sequence[Choice] = (),
    ) -> None:
        self.source, self.floor, self.laws = source, floor, laws
        self.rules = rules or Rules()
        self._again = again
        self.start = tuple(start)  # effects that the search begins with
        self._entered: dict[str, float] = {}
        self._instead: dict[str, tuple[str, ...]] = {}  # two effects that explain more than one
        self._shapes: tuple[NoiseModel, ...] = laws.shapes

    def view(self, chosen: Sequence[Choice]) -> View:
        """Return the refitted problem under the present noise."""
        return View(self.source.problem(chosen, self.floor.noise), self.floor.noise)

    def chosen(self) -> tuple[Choice, ...]:
        """Add effects while they are significant."""
        return tuple(self._added()[0])

    def _added(self) -> tuple[list[Choice], tuple[Found, ...]]:
        chosen: list[Choice] = list(self.start)
        first: tuple[Found, ...] = ()
        for _ in range(self.rules.most):
            view = self.view(chosen)
            ranked = self._with_ratios(view, self.ranked(view))
            first = first or tuple(r.found for r in ranked)
            if not ranked or not self._enters(ranked[0]):
                break
            best = ranked[0].found
            if chosen and not self._adds(ranked[0], view, chosen):
                break
            self._entered[best.candidate.name] = ranked[0].p_value
            chosen.append(Choice(best.candidate.name, best.theta))
            chosen = self._made_supple(chosen)
            if best.candidate.event:
                self._renew_floor(chosen)
            elif len(chosen) == 1 and self.rules.pairs and self.rules.most > 1:
                chosen = self._or_two(view, chosen)
        return chosen, first

    def run(self) -> SearchResult:
        """Add effects while they are significant, then try every slot again."""
        start = self.floor, self.laws
        chosen, first = self._added()
        slots = self._settled(chosen)
        if not slots:
            self.floor, self.laws = start
        explained = 0.0
        if slots:
            before, after = self.view([]), self.view([s.choice for s in slots])
            explained = chi_square(before) - chi_square(after)
        return SearchResult(
            slots=slots,
            floor=self.floor,
            explained=explained,
            over_wander=self._over_wander([s.choice for s in slots]),
            first=first,
        )

    def _over_wander(self, chosen: Sequence[Choice]) -> float:
        """Return how much likelier the events chosen are than a smooth wander in their place."""
        passing = self.view([]).problem.events
        view = self.view([c for c in chosen if c.name not in passing])
        events = [c for c in chosen if c.name in passing]
        if not events or not self._shapes:
            return float("inf")
        by_name = {c.name: c for c in view.problem.candidates}
        columns = np.hstack([by_name[c.name].signature(c.theta).columns for c in events])
        unknowns = columns.shape[1] + sum(len(c.theta) for c in events)
        return over_wander(view.problem, self._shapes, columns, unknowns)

    def ranked(self, view: View) -> list[Ranked]:
        """Return every candidate at its best, under the present noise, best first."""
        made: list[Ranked] = []
        for found in Prepared(view, view.problem.candidates).scan():
            name = found.candidate.name
            p_value = self._p_value(name, found.grid_gain)
            made.append(Ranked(found, found.gain - self._luck(name), p_value))
        return sorted(made, key=lambda r: -r.score)

    def _with_ratios(self, view: View, ranked: list[Ranked]) -> list[Ranked]:
        """Let events count with their likelihood ratios: each beside its own noise."""
        if not self._shapes:
            return ranked
        steady = [r for r in ranked if not r.found.candidate.event]
        made = [*steady, *self._events(view)]
        ranked = sorted(made, key=lambda r: -r.score)
        return self._in_order(view, self._lasting_first(view, ranked))

    def _lasting_first(self, view: View, ranked: list[Ranked]) -> list[Ranked]:
        """Leave out what happens once where one run is all there is and something else enters.

        What repeats can then be tested by a second run; a step that happened beside it cannot, and
        a step of free instant imitates a loop that turns back but once.
        """
        staying = lasting(view, ranked)
        return staying if any(self._enters(r) for r in staying) else ranked

    def _events(self, view: View) -> list[Ranked]:
        """Return the events where they are likeliest."""
        made: list[Ranked] = []
        for candidate in events_of(view.problem):
            at = placed(view.problem, self._shapes, candidate)
            name, gain = candidate.name, at.ratio
            found = Found(candidate=candidate, theta=at.theta, gain=gain, grid_gain=gain)
            made.append(Ranked(found, gain - self._luck(name), self._p_value(name, gain)))
        return made

    def _in_order(self, view: View, ranked: list[Ranked]) -> list[Ranked]:
        """Put first what enters first: of what repeats and of events, whichever is likelier.

        What repeats poses as an event while it is missing, and an event as what repeats, so the
        two are compared by the same likelihood ratio.
        """
        entering = [r for r in ranked if self._enters(r)]
        steady = next((r for r in entering if not r.found.candidate.event), None)
        event = next((r for r in entering if r.found.candidate.event), None)
        first = steady or event
        if steady and event and self._beside_own_noise(view, [steady])[0].score < event.score:
            first = event
        return ranked if first is None else [first, *(r for r in ranked if r is not first)]

    def _beside_own_noise(self, view: View, steady: Sequence[Ranked]) -> list[Ranked]:
        """Return effects that repeat with their likelihood ratios, as events have theirs."""
        points = [fixed(r.found.candidate.signature(r.found.theta)) for r in steady]
        data = view.problem.residual[:, None]
        ratios = event_ratios(view.problem, self._shapes, data, points)[:, 0].tolist()
        return [
            replace(r, score=ratio - self._luck(r.found.candidate.name))
            for r, ratio in zip(steady, ratios, strict=True)
        ]

    def _enters(self, one: Ranked) -> bool:
        event = one.found.candidate.event
        return one.p_value < (self.rules.alpha_event if event else self.rules.alpha)

    def _luck(self, name: str) -> float:
        return self.laws.gains[name].mean if name in self.laws.gains else 0.0

    def _p_value(self, name: str, gain: float) -> float:
        return self.laws.p_family(name, gain)

    def _adds(self, one: Ranked, view: View, chosen: Sequence[Choice]) -> bool:
        """Tell whether a further effect is more than the ill-known shape of those before it.

        What one event leaves of a random walk looks like another: a second event must be as clear
        as a second effect that repeats. Beside what repeats, an event is judged as the first is,
        unless the rules ask for more.
        """
        candidate, events = one.found.candidate, view.problem.events
        if candidate.name in events and any(c.name in events for c in chosen):
            return one.score >= self.rules.further
        if candidate.event:
            return one.score >= self.rules.further_event
        return not self._is_shape(one, view)

    def _is_shape(self, one: Ranked, view: View) -> bool:
        """Tell whether an effect is only the ill-known shape of those named before it."""
        if one.score < self.rules.further:
            return True
        plain = self.view(self.start)  # the shape of the equation's own terms is known
        signature = one.found.candidate.signature(one.found.theta)
        alone, beside = plain.strength(signature), view.strength(signature)
        imitated = 1.0 - (beside / alone) ** 2 if alone > 0 else 1.0
        total = chi_square(plain) - chi_square(view)
        return imitated > 0.3 and one.found.gain < self.rules.relative**2 * total

    def _made_supple(self, chosen: list[Choice]) -> list[Choice]:
        """Give the last effect its family's richer member when that explains clearly more."""
        last = chosen[-1]
        view = self.view(chosen[:-1])
        head = next(c for c in view.problem.candidates if c.name == last.name)
        if head.richer is None:
            return chosen
        plain = Prepared(view, [head]).scan()[0]
        rich = Prepared(view, [head.richer]).scan()[0]
        more = unknowns_of(head.richer) - unknowns_of(head)
        if rich.gain - plain.gain > self.rules.supple + 2.0 * more:
            return [*chosen[:-1], Choice(last.name, rich.theta, rich=True)]
        return chosen

    def _or_two(self, view: View, chosen: list[Choice]) -> list[Choice]:
        """Return two effects instead of the first where they explain clearly more than it.

        Where they explain more, but not enough for a second name, the first is no bare name.
        """
        steady = [c for c in view.problem.candidates if not c.event]
        pair = best_pair(view, steady)
        if pair is None:
            return chosen
        both = self._made_supple(self._made_supple(list(pair))[::-1])[::-1]
        more = chi_square(self.view(chosen)) - chi_square(self.view(both))
        beside = self.view(both[:1])
        second = next(c for c in beside.problem.candidates if c.name == both[1].name)
        found = Prepared(beside, [second]).scan()[0]
        own = Ranked(found, found.gain - self._luck(second.name), 0.0)
        if more > self.rules.further and not self._is_shape(own, beside):
            return both
        names = tuple(c.name for c in both)
        if more > self.rules.least and chosen[0].name not in names:
            self._instead[chosen[0].name] = names
        return chosen

    def _renew_floor(self, chosen: Sequence[Choice]) -> None:
        """Estimate the noise beside the effects chosen, and its null laws with it."""
        problem = self.source.problem(chosen, self.floor.noise)
        if problem.noise is not None:
            return
        self.floor = estimate_floor(problem.times, problem.residual, problem.saturated)
        if self._again is not None:
            laws = self._again(self.source.problem(chosen, self.floor.noise), self.floor)
            self.laws = replace(laws, gains={**self.laws.gains, **laws.gains})
            self._shapes = tuple(dict.fromkeys((*self._shapes, *laws.shapes)))

    def _settled(self, chosen: list[Choice]) -> tuple[Slot, ...]:
        """Try every slot again beside the others; drop what no longer stands."""
        slots: list[Slot] = []
        for _ in range(2):
            slots = []
            moved = False
            for k in range(len(chosen)):
                others = [c for j, c in enumerate(chosen) if j != k]
                slot = self._slot(others, chosen[k])
                if slot is None:
                    return self._settled(others)
                swapped = slot.choice.name != chosen[k].name
                chosen[k] = slot.choice
                slots.append(slot)
                if swapped:
                    moved = True
                    self._entered[slot.choice.name] = slot.p_value
                    self._renew_floor(chosen)
            if not moved:
                return tuple(slots)
        return tuple(slots) if chosen else ()

    def _slot(self, others: Sequence[Choice], present: Choice) -> Slot | None:
        view = self.view(others)
        ranked = self.ranked(view)
        if self._shapes and present.name in {c.name for c in events_of(view.problem)}:
            # a noise estimated beside one event favours that one: each is given its own
            steady = [r for r in ranked if not r.found.candidate.event]
            ranked = [*self._events(view), *self._beside_own_noise(view, steady)]
            ranked = sorted(ranked, key=lambda r: -r.score)
            if present.name not in view.problem.events:
                ranked = lasting(view, ranked)
            able = (r for r in ranked if r.found.candidate.event or r.p_value < self.rules.alpha)
            first = next(able)
            ranked = [first, *(r for r in ranked if r is not first)]
        else:
            ranked = self._with_rich(view, ranked, present)
        ranked = simplest_first(ranked)
        best = ranked[0].found
        name = best.candidate.name
        # an event was judged when it entered; the noise has since been estimated beside it
        p_value = ranked[0].p_value
        if best.candidate.event:
            p_value = self._entered.get(name, self._entered.get(present.name, 1.0))
        # beside no other effect it stands as it entered
        alone = best.candidate.event and not others
        if not alone and ranked[0].score < self.rules.least:
            return None
        if not best.candidate.event and p_value >= self.rules.alpha:
            return None
        top = max(r.score for r in ranked)
        below = [(r.found.candidate.name, top - r.score) for r in ranked]
        alias = tuple(n for n, b in below if b < self.rules.alias)
        if not others:
            alias = tuple(dict.fromkeys((*alias, *self._instead.get(name, ()))))
        return Slot(
            choice=Choice(name, best.theta, rich=ranked[0].rich),
            gain=gain_of(view, best) if best.candidate.event else best.gain,
            p_value=p_value,
            rivals=tuple(below[1:]),
            alias=alias,
        )

    def _with_rich(self, view: View, ranked: list[Ranked], present: Choice) -> list[Ranked]:
        """Let the richer member stand for its family where it was chosen, and for every rival.

        A rival is told from an effect only when the most supple member of its family is. One whose
        plain member explains less than half as much is none.
        """
        near = 0.5 * max(r.score for r in ranked)

        def supple(one: Ranked) -> Ranked:
            if one.found.candidate.name == present.name:
                return self._richer(view, one) if present.rich else one
            rich = self._richer(view, one) if one.score > near else one
            return rich if rich.score > one.score else one

        return sorted(map(supple, ranked), key=lambda r: -r.score)

    def _richer(self, view: View, plain: Ranked) -> Ranked:
        candidate = plain.found.candidate
        if candidate.richer is None:
            return plain
        rich = Prepared(view, [candidate.richer]).scan()[0]
        more = unknowns_of(candidate.richer) - unknowns_of(candidate)
        found = Found(
            candidate=candidate,
            theta=rich.theta,
            gain=rich.gain,
            grid_gain=max(plain.found.grid_gain, rich.grid_gain),
        )
        score = plain.score + rich.gain - plain.found.gain - 2.0 * more
        return Ranked(found, score, plain.p_value, rich=True)
