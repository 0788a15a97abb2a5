"""The chamber runs of an accelerometer as a measurement for the investigation."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.discrepancy.foresight import Foresight
from errormodel.discrepancy.gate import FactorFinding, Judgement
from errormodel.discrepancy.measurement import Measurement, Revision, Searched
from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.search.choices import Choice, Rules
from errormodel.discrepancy.search.state import SearchState
from errormodel.noise.model import NoiseModel
from thermo.discrepancy.experiment import Experiment, propose
from thermo.discrepancy.experiment_menu import NO_LIMITS, Limits
from thermo.discrepancy.held_out import RunGap, gap_of_run, reading_residual_ug
from thermo.discrepancy.problem.source import ThermalSource
from thermo.discrepancy.shape.found import against_shape
from thermo.discrepancy.shared import SearchedChannel, Unlike, unlike_effects

# Orders of temperature are equal in heating and cooling, so a history effect can be added.
ORDERS = frozenset({"bias_temperature_order", "scale_temperature_order"})
# Slow noise above this multiple of the white noise of a reading is not instrument drift.
MOST_DRIFT = 3.0
# Degrees of freedom from which the white noise within blocks is used.
ENOUGH_WITHIN = 100


class ChamberRuns(Measurement[RunGap, Experiment]):
    """The runs of one accelerometer, with the source of their problems."""

    parts_name = "runs"

    def __init__(
        self, source: ThermalSource, shape_name: str | None = None, limits: Limits = NO_LIMITS
    ) -> None:
        self.source, self.shape_name, self.limits = source, shape_name, limits
        self.name = source.channel.serial

    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the engine's problem of the model with some effects, refitted under a noise."""
        return self.source.problem(chosen, noise)

    def rules(self, rules: Rules) -> Rules:
        """Return the thresholds; a single run allows no second name."""
        return rules if self.source.seen.runs > 1 else replace(rules, most=1)

    def wider_rules(self, result: SearchState) -> Rules | None:
        """Return thresholds for two names in one run if the first is an order."""
        if self.source.seen.runs == 1 and {c.name for c in result.found} & ORDERS:
            return replace(result.rules, most=2)
        return None

    def refuted(
        self, of: Searched[RunGap, Experiment], every: Sequence[Searched[RunGap, Experiment]]
    ) -> tuple[Unlike, ...]:
        """Return effects with a shared cause and different sizes in the accelerometers."""
        channels = {id(s): _channel(s) for s in every}
        return unlike_effects(channels[id(of)], list(channels.values()))

    def without_effects(self, names: frozenset[str]) -> "ChamberRuns":
        """Return the runs with a smaller library."""
        source = self.source
        kept = [e for e in source.effects if e.name not in names]
        return ChamberRuns(
            ThermalSource(source.channel, source.model, kept), self.shape_name, self.limits
        )

    def drifts_too_much(self, result: SearchState) -> bool:
        """Return True if the estimated slow noise exceeds the possible drift of an instrument."""
        noise = result.floor.noise
        drift = noise.white * np.sqrt(noise.slow_share(self.source.blocks.times.span_s))
        return bool(drift > MOST_DRIFT * self._white_ug(result))

    def revised(
        self, judgement: Judgement, result: SearchState, places: Sequence[FactorFinding]
    ) -> Revision:
        """Hold names against a shape of one quantity, where one is asked for."""
        del places
        if self.shape_name is None:
            return Revision(judgement, result)
        return against_shape(self.source, judgement, result, self.shape_name)

    def _white_ug(self, result: SearchState) -> float:
        """Return the white sigma of a reading: from within blocks if there are enough readings."""
        source, noise = self.source, result.floor.noise
        fitted = source.fitted(result.found, noise)
        sigma, dof = source.blocks.spread(reading_residual_ug(source.channel, fitted))
        if dof > ENOUGH_WITHIN:
            return sigma
        return noise.white * float(np.sqrt(source.blocks.usual))

    def invisible(self, foresight: Foresight) -> tuple[str, ...]:
        """Return the effects that the runs cannot show at all, whatever their size."""
        source = self.source
        shown = set(foresight.names) - set(foresight.invisible)
        held = {e.name for e in source.effects if source.holds_some(e)}
        own = {t.name for t in source.model.terms}
        some = [e for e in source.effects if not e.changes or e.changes in own]
        return tuple(e.name for e in some if e.name not in shown | held)

    def next_experiment(
        self, result: SearchState, judgement: Judgement, invisible: tuple[str, ...]
    ) -> Experiment | None:
        """Return what would tell an alias set apart, or show what these runs cannot."""
        return propose(self.source, result, judgement, invisible, result.floor, self.limits)

    def parts(self, choices: Sequence[Choice]) -> Sequence[int]:
        """Return the numbers of the runs; empty for a single run."""
        del choices
        runs = len(self.source.channel.run_ids)
        return range(runs) if runs > 1 else ()

    def without_part(self, part: int) -> "ChamberRuns":
        """Return the other runs."""
        source, channel = self.source, self.source.channel
        others = tuple(r for k, r in enumerate(channel.run_ids) if k != part)
        seen = channel.take(channel.runs_mask(others))
        return ChamberRuns(ThermalSource(seen, source.model, source.effects))

    def gap(
        self, part: int, others: Measurement[RunGap, Experiment], chosen: Sequence[Choice]
    ) -> RunGap:
        """Predict a run from the others."""
        assert isinstance(others, ChamberRuns)
        run = self.source.channel.run_ids[part]
        return gap_of_run(self.source, run, others.source, chosen)


def _channel(one: Searched[RunGap, Experiment]) -> SearchedChannel:
    assert isinstance(one.measurement, ChamberRuns)
    return SearchedChannel(one.measurement.source, one.result)
