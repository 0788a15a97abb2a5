"""Effects common to several accelerometers: equal in all of them, or refuted by one of them.

An error of the head, the chamber or the digitiser has the same coefficients in every accelerometer
of the same runs. It is fitted beside all other findings, once with separate and once with common
coefficients. The loss of chi-square with the common coefficients tests whether they are equal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Candidate, Theta, columns_of
from errormodel.discrepancy.scan import NOTHING, Prepared, View
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.ranking import residual_of
from errormodel.discrepancy.search.state import SearchState
from thermo.discrepancy.problem.source import ThermalSource
from thermo.library.effects import Cause, ThermalEffect

# False-alarm rate of the test for equal sizes.
ALPHA = 1e-3
# The time of a step is determined to some three block means.
INSTANT_BLOCKS = 3.0
COMMON: frozenset[Cause] = frozenset({"head", "chamber", "digitiser"})


@dataclass(frozen=True, slots=True, eq=False)
class SearchedChannel:
    """One accelerometer's search."""

    source: ThermalSource
    result: SearchState

    @property
    def serial(self) -> str:
        """Serial number."""
        return self.source.channel.serial


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedEffect:
    """A cause that several accelerometers shared.

    Attributes
    ----------
    effect : str
    serials : tuple of str
        The accelerometers that show it.
    owner : str
        Its cause: head, chamber, digitiser, or the run in which it happened.
    """

    effect: str
    serials: tuple[str, ...]
    owner: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Unlike:
    """An effect with a shared cause whose size differs between the accelerometers.

    `excess` is the chi-square lost with common coefficients, `freedom` the difference in the number
    of coefficients.
    """

    effect: str
    serials: tuple[str, ...]
    owner: str
    excess: float
    freedom: int

    @property
    def sentence(self) -> str:
        """The reason for the withdrawal, in words."""
        return (
            f"{self.effect} is left out: it is the {self.owner}'s, which {', '.join(self.serials)} "
            f"shared, and would be alike in all of them; it is not (chi-square {self.excess:.0f} "
            f"for {self.freedom} coefficients)."
        )


def together(of: SearchedChannel, every: Sequence[SearchedChannel]) -> tuple[SearchedChannel, ...]:
    """Return the accelerometers with runs in common with one, including itself."""
    runs = set(of.source.channel.run_ids)
    return tuple(s for s in every if runs & set(s.source.channel.run_ids))


def unlike_effects(of: SearchedChannel, every: Sequence[SearchedChannel]) -> tuple[Unlike, ...]:
    """Return the effects found in an accelerometer that its neighbours in the same runs refute.

    An effect with different sizes is refuted, unless its sizes are equal once each accelerometer
    has its own terms, and it is then as significant as a further effect must be.
    """
    group = together(of, every)
    if len(group) < 2:
        return ()
    known = {e.name: e for e in of.source.effects}
    refuted: list[Unlike] = []
    for effect in (known[n] for n in sorted(of.result.names) if known[n].cause in COMMON):
        first = _compared(effect, group, beside_equation=False)
        if first.alike:
            continue
        second = _compared(effect, group, beside_equation=True)
        if not (second.alike and second.common > of.result.rules.further):
            refuted.append(first.evidence_against(effect, group))
    return tuple(refuted)


def shared_effects(every: Sequence[SearchedChannel]) -> tuple[SharedEffect, ...]:
    """Return the causes that several accelerometers shared, each once.

    These are effects of the head, the chamber and the digitiser that `unlike_effects` did not
    refute, and events in several accelerometers at one time of the same run.
    """
    found: dict[tuple[str, frozenset[str]], SharedEffect] = {}
    for of in every:
        for effect in of.source.effects:
            showing = [s for s in together(of, every) if effect.name in s.result.names]
            if effect.cause == "run":
                showing = [s for s in showing if _at_one_moment(effect.name, of, s)]
            elif effect.cause not in COMMON:
                continue
            if of in showing and len(showing) > 1:
                serials = tuple(s.serial for s in showing)
                one = SharedEffect(effect=effect.name, serials=serials, owner=effect.cause)
                found.setdefault((effect.name, frozenset(serials)), one)
    return tuple(found.values())


def _at_one_moment(name: str, one: SearchedChannel, other: SearchedChannel) -> bool:
    """Return True if an event in both has the same time, if it has one."""
    thetas = [
        next((s.choice.theta for s in x.result.slots if s.choice.name == name), None)
        for x in (one, other)
    ]
    if thetas[0] is None or thetas[1] is None:
        return False
    near_h = INSTANT_BLOCKS * one.source.blocks.times.step_s / 3600.0
    return all(abs(a - b) <= near_h for a, b in zip(thetas[0], thetas[1], strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Comparison:
    """Chi-square that an effect explains with common coefficients, and what they lose."""

    common: float
    excess: float
    freedom: int

    @property
    def alike(self) -> bool:
        return self.freedom < 1 or float(stats.chi2.sf(self.excess, self.freedom)) > ALPHA

    def evidence_against(self, effect: ThermalEffect, group: Sequence[SearchedChannel]) -> Unlike:
        return Unlike(
            effect=effect.name,
            serials=tuple(s.serial for s in group),
            owner=effect.cause,
            excess=self.excess,
            freedom=self.freedom,
        )


def _compared(
    effect: ThermalEffect, group: Sequence[SearchedChannel], *, beside_equation: bool
) -> _Comparison:
    """Fit an effect with common and with separate coefficients."""
    views = [_beside(effect.name, s, equation=beside_equation) for s in group]
    found = [(v, c) for v in views if (c := _most_flexible(effect.name, v)) is not None]
    theta = _where_clearest(found)
    parts = [_Normal.of(view, columns_of(c.signature(theta))) for view, c in found]
    gains = [p.gain() for p in parts]
    common, rank = _Normal.of_all(parts).gain()
    return _Comparison(
        common=common,
        excess=sum(g for g, _ in gains) - common,
        freedom=sum(r for _, r in gains) - rank,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    """Normal equations of an effect beside everything else; `lengths2` of its columns alone."""

    matrix: FloatArray
    right: FloatArray
    lengths2: FloatArray

    @classmethod
    def of(cls, view: View, columns: FloatArray) -> "_Normal":
        white = view.white(columns)
        beside = view.beside_base(white)
        return cls(beside.T @ beside, beside.T @ residual_of(view), np.sum(white**2, axis=0))

    @classmethod
    def of_all(cls, parts: Sequence["_Normal"]) -> "_Normal":
        return cls(
            np.sum([p.matrix for p in parts], axis=0),
            np.sum([p.right for p in parts], axis=0),
            np.sum([p.lengths2 for p in parts], axis=0),
        )

    def gain(self) -> tuple[float, int]:
        """Return the chi-square that the columns explain, and the number of independent columns.

        A column that the others almost reproduce gives no information.
        """
        scale = np.sqrt(np.where(self.lengths2 > 0.0, self.lengths2, 1.0))
        values, vectors = np.linalg.eigh(self.matrix / np.outer(scale, scale))
        kept = values > NOTHING**2
        along = vectors[:, kept].T @ (self.right / scale)
        return float(np.sum(along**2 / values[kept])), int(np.count_nonzero(kept))


def _beside(name: str, of: SearchedChannel, *, equation: bool) -> View:
    """Return the view of an effect in an accelerometer, beside its other findings.

    With `equation`, beside every term of the equation that the present model lacks as well.
    """
    others = [s.choice for s in of.result.slots if name not in (s.choice.name, *s.alias)]
    if equation:
        held = {c.name for c in others}
        joint = [c for c in of.result.view(others).problem.candidates if c.joint]
        others += [Choice(c.name, c.grid[0]) for c in joint if c.name not in held]
    return of.result.view(others)


def _most_flexible(name: str, view: View) -> Candidate | None:
    """Return the flexible form of an effect; None if the runs lack its input."""
    found = next((c for c in view.problem.candidates if c.name == name), None)
    return found and (found.flexible or found)


def _where_clearest(found: Sequence[tuple[View, Candidate]]) -> Theta:
    """Return the nonlinear parameters of the accelerometer that shows the effect most."""
    every = [f for view, candidate in found for f in Prepared(view, [candidate]).scan()]
    return max(every, key=lambda f: f.gain).theta
