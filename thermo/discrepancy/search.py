"""The search of each accelerometer's runs, and of all that shared a head or a run together."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.discrepancy.choices import Rules
from errormodel.discrepancy.foresight import Foresight, foresee
from errormodel.discrepancy.nulls import Calibration, calibrate
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.several import search_all
from errormodel.noise.floor import estimate_floor
from errormodel.noise.model import NoiseFit, NoiseModel
from thermo.discrepancy.shared import Searched, Unlike, unlike_effects
from thermo.discrepancy.source import ThermalSource

ORDERS = frozenset({"bias_temperature_order", "scale_temperature_order"})
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How a search is made: thresholds, simulated nulls and their seed, threads, who is told."""

    rules: Rules
    draws: int
    seed: int
    workers: int
    say: Tell

    def calibrated(self, problem: Problem, floor: NoiseFit) -> Calibration:
        """Simulate the null laws of a problem."""
        rng = np.random.default_rng(self.seed)
        return calibrate(problem, floor, draws=self.draws, rng=rng, workers=self.workers)


@dataclass(frozen=True, slots=True, eq=False)
class Found(Searched):
    """One accelerometer's search with what its verdict needs.

    Attributes
    ----------
    foresight : Foresight
    rules : Rules
    floor : NoiseFit
    laws : Calibration
        Of the present model.
    unlike : tuple of Unlike
        Effects of a shared owner that the other accelerometers refute.
    replaced : bool
        Other effects have come in their place, and explain clearly less than they did: their names
        do not stand.
    """

    foresight: Foresight
    rules: Rules
    floor: NoiseFit
    laws: Calibration
    unlike: tuple[Unlike, ...] = ()
    replaced: bool = False


def search_together(sources: Sequence[ThermalSource], settings: Settings) -> tuple[Found, ...]:
    """Search each accelerometer, then leave out what those that shared its owner refute.

    Parameters
    ----------
    sources : sequence of ThermalSource
        One an accelerometer.
    settings : Settings

    Returns
    -------
    tuple of Found
        In the same order.
    """
    found = [_searched(source, settings) for source in sources]
    while True:
        refuted = [unlike_effects(one, found) for one in found]
        if not any(refuted):
            return tuple(found)
        found = [
            _without(one, unlike, settings) if unlike else one
            for one, unlike in zip(found, refuted, strict=True)
        ]


def _without(one: Found, unlike: tuple[Unlike, ...], settings: Settings) -> Found:
    """Search an accelerometer again with effects left out of the library.

    Noise and nulls stay: with fewer effects, chance could do no more than it can with all.
    """
    names = {u.effect for u in unlike}
    settings.say(f"{one.serial}: once more without {', '.join(sorted(names))}")
    source = one.source
    kept = [e for e in source.effects if e.name not in names]
    fewer = ThermalSource(source.channel, source.model, kept)
    again = _found(fewer, one.floor, one.laws, settings)
    others = {s.choice.name for s in again.result.slots} - one.named
    lost = one.result.explained - again.result.explained
    rules = again.rules
    clearly = max(rules.further, rules.relative**2 * again.result.explained)
    return replace(
        again,
        unlike=(*one.unlike, *unlike),
        replaced=one.replaced or (bool(others) and lost > clearly),
    )


def _searched(source: ThermalSource, settings: Settings) -> Found:
    """Go through noise, nulls and library for one accelerometer."""
    serial, say = source.channel.serial, settings.say
    say(f"{serial}: noise floor of {len(source.blocks.times)} block means")
    plain = source.problem((), NoiseModel())
    floor = estimate_floor(plain.times, plain.residual, plain.saturated)
    say(f"{serial}: {settings.draws} simulated nulls")
    laws = settings.calibrated(source.problem((), floor.noise), floor)
    return _found(source, floor, laws, settings)


def _found(source: ThermalSource, floor: NoiseFit, laws: Calibration, settings: Settings) -> Found:
    """Search the library under a noise and its null laws."""
    # one run does not carry a second name
    rules = settings.rules if source.seen.runs > 1 else replace(settings.rules, most=1)
    problem = source.problem((), floor.noise)
    foresight = foresee(View(problem, floor.noise), problem.candidates)
    settings.say(f"{source.channel.serial}: trying {len(problem.candidates)} effects")
    search, result = search_all(source, floor, laws, rules, settings.calibrated)
    if source.seen.runs == 1 and {s.choice.name for s in result.slots} & ORDERS:
        # a missing order is alike in heating and cooling: history may be beside it
        two = replace(rules, most=2)
        search, result = search_all(source, floor, laws, two, settings.calibrated)
    return Found(source, search, result, foresight=foresight, rules=rules, floor=floor, laws=laws)
