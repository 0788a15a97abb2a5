"""Filters of the present and of larger models, each run once when the search needs it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from errormodel.discrepancy.problem import Problem
from errormodel.discrepancy.search.choices import Choice
from errormodel.filter.steps import NO_GATE
from errormodel.noise.model import NoiseModel
from sinscal.calibration.rig import Mode, RigCalibration, calibrate
from sinscal.filter.data import RigNoise, cycle_data
from sinscal.library import BASIC, rig_library
from sinscal.library.angle import MOUNT
from sinscal.library.groups import RigEffect
from sinscal.library.jump import constant_error_step
from sinscal.model.larger_model import RigModelFile
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from sinscal.recording.run import RigRun
from sinscal.sensitivity.problem import FilterProblem


@dataclass(frozen=True, eq=False)
class RigSource:
    """Source of rig-filter problems with some effects added; each model runs once.

    `present` contains the terms of the filter in addition to the basic errors.
    """

    run: RigRun
    mode: Mode
    noise: RigNoise
    interval_s: float = 1.0
    present: RigModelFile = field(default_factory=RigModelFile)
    effects: tuple[RigEffect, ...] = field(default_factory=lambda: rig_library().effects)
    _filters: dict[tuple[Choice, ...], FilterProblem] = field(
        default_factory=dict[tuple[Choice, ...], FilterProblem], repr=False
    )
    _problems: dict[tuple[Choice, ...], Problem] = field(
        default_factory=dict[tuple[Choice, ...], Problem], repr=False
    )

    def with_noise(self, noise: RigNoise) -> "RigSource":
        """Return the same source under another noise; every model is run again."""
        return self._anew(self.run, noise)

    def of_cycles(self, wanted: Sequence[int]) -> "RigSource":
        """Return the source of some cycles alone, from 0."""
        return self._anew(self.run.take_cycles(wanted), self.noise)

    def _anew(self, run: RigRun, noise: RigNoise) -> "RigSource":
        return RigSource(
            run, self.mode, noise, self.interval_s, present=self.present, effects=self.effects
        )

    @property
    def shown(self) -> tuple[RigEffect, ...]:
        """The effects for which the run has the necessary signals."""
        angle = self.mode == "precise"
        missing = [e for e in self.effects if not self.holds(e)]
        return tuple(e for e in missing if e.recorded(self.run, angle=angle))

    def holds(self, effect: RigEffect) -> bool:
        """Tell whether an effect is in the present model."""
        if effect.step:
            return any(s.kind == effect.step for s in self.present.steps)
        if effect.groups:
            return set(effect.groups) <= set(self.present.groups)
        return self.present.mount

    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the problem of the enlarged filter, run again."""
        del noise  # innovations are white
        key = _key(chosen)
        if key not in self._problems:
            self._problems[key] = self.filter_with(chosen).problem()
        return self._problems[key]

    def filter_with(self, chosen: Sequence[Choice]) -> FilterProblem:
        """Return the filter of the present model with some effects."""
        key = _key(chosen)
        if key not in self._filters:
            names = {c.name for c in chosen}
            left = tuple(e for e in self.shown if e.name not in names)
            cycles = cycle_data(self.run, self.interval_s)
            found = self._calibrated(key)
            self._filters[key] = FilterProblem(self.run, found, cycles, left)
        return self._filters[key]

    def _calibrated(self, chosen: Sequence[Choice]) -> RigCalibration:
        effects = [rig_library().by_name[c.name] for c in chosen]
        steps = [
            constant_error_step(e.step, c.theta[0])
            for c, e in zip(chosen, effects, strict=True)
            if e.step
        ]
        groups = (*BASIC, *self.present.groups, *(g for e in effects for g in e.groups))
        sensors = sensor_model(
            tuple(dict.fromkeys(groups)),
            more=[*(s.group for s in self.present.steps), *steps],
            t_ref_c=self.present.t_ref_c,
            gravity_m_s2=self.run.facts.site.gravity_m_s2,
        )
        prior = make_prior(sensors)
        if not (self.present.mount or any(e.name == MOUNT for e in effects)):
            prior = replace(prior, mount_sigma_rad=0.0)
        return calibrate(
            self.run, self.mode, sensors=sensors, prior=prior, noise=self.noise,
            interval_s=self.interval_s, gate=NO_GATE,
        )  # fmt: skip


def _key(chosen: Sequence[Choice]) -> tuple[Choice, ...]:
    return tuple(sorted(chosen, key=lambda c: c.name))
