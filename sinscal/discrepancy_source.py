"""The rig filter's innovations as the problem of the search for missing effects.

The innovations over their sigmas are white, of unit variance, when nothing is missing. What an
effect that the filter does not know would leave in them is had by sending its columns through the
same gains (Willsky and Jones 1976). An effect chosen joins the filter itself, which is iterated
anew: the enlarged model is verified by its own run, not by a regression.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.discrepancy.choices import Choice
from errormodel.discrepancy.coloured import NoiseShape, TimeBase
from errormodel.discrepancy.problem import Candidate, Problem, Signature, Theta
from errormodel.filtering import NO_GATE, Steps, run_filter
from errormodel.gains import signatures
from sinscal.calibrate import Mode, RigCalibration, calibrate
from sinscal.consistency import rows_of_rig
from sinscal.discrepancy_factors import rig_factors
from sinscal.priors import make_prior
from sinscal.rig_effects import BY_NAME, EFFECTS, RigEffect
from sinscal.rigdata import CycleData, RigNoise, cycle_data
from sinscal.rigfilter import make_steps
from sinscal.run import BoolArray, RigRun
from sinscal.sensors import T_REF_C, SensorModel, sensor_model
from sinscal.terms import BASIC, bias_step

STEP_TIMES = 40  # of the grid of a jump's times
FINER = 12  # tried between a grid time and each of its neighbours
EDGE_S = 30.0  # a jump nearer to an end of the run is no more than the start's own uncertainty


@dataclass(frozen=True, eq=False)
class FilterProblem:
    """One model's filter: its calibration and what effects would leave in its innovations.

    `rows` are the rows of measurements that are looked at.
    """

    run: RigRun
    found: RigCalibration
    cycles: tuple[CycleData, ...]
    effects: tuple[RigEffect, ...]
    rows: tuple[int, ...]
    _made: dict[tuple[str, Theta], Signature] = field(
        default_factory=dict[tuple[str, Theta], Signature], repr=False
    )

    @cached_property
    def gains(self) -> FloatArray:
        """The gains of the last pass."""
        again = run_filter(self.found.start, self.found.steps, with_gains=True)
        return again.gains

    @cached_property
    def elapsed_s(self) -> FloatArray:
        """End of each step from the start of the run."""
        begin = np.array([c.measured.begin_s for c in self.cycles])
        numbers = np.maximum(np.append(self.found.cycle_of_step[1:], -1), self.found.cycle_of_step)
        return begin[numbers] + self.found.time_s

    @cached_property
    def kept(self) -> BoolArray:
        """The innovations looked at, shape (K, m)."""
        m = self.found.steps.h.shape[1]
        return self.found.filtered.used & np.array([k in self.rows for k in range(m)])

    @cached_property
    def step_of(self) -> IntArray:
        """The step of each innovation used."""
        return np.nonzero(self.kept)[0]

    @cached_property
    def row_of(self) -> IntArray:
        """The row of each innovation used."""
        return np.nonzero(self.kept)[1]

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the rows of measurements."""
        return rows_of_rig(self.found.steps.h.shape[1]).names

    @cached_property
    def _wider(self) -> tuple[Steps, tuple[str, ...], dict[str, str]]:
        """The steps about the same nominal of a model that has every effect's unknowns."""
        found = self.found
        groups = [g for e in self.effects for g in e.groups]
        sensors = _with_groups(found.sensors, groups)
        values = sensors.start_values()
        for name, value in zip(found.sensors.names, found.nominal.values, strict=True):
            values[sensors.names.index(name)] = value
        layout = replace(found.layout, parameters=sensors.names)
        nominal = replace(found.nominal, values=values)
        gravity = self.run.facts.site.gravity_m_s2
        steps = make_steps(self.cycles, sensors, nominal, layout, found.noise, gravity)
        return steps, layout.names, sensors.units

    def columns_of(self, effect: RigEffect) -> tuple[list[str], FloatArray, FloatArray]:
        """Return an effect's unknowns, and how each enters measurements and motion."""
        steps, names, _ = self._wider
        belongs = effect.unknowns()
        if effect.step:
            names_of = [f"{effect.step}_bias_{a}" for a in "xyz"]
        else:
            names_of = [n for n in names if belongs(n)]
        places = [names.index(n) for n in names_of]
        return names_of, steps.h[:, :, places], steps.phi[:, :, places]

    def unit_of(self, effect: RigEffect) -> str:
        """Return the unit of an effect's first unknown."""
        name = self.columns_of(effect)[0][0]
        return self._wider[2].get(name, "rad")

    def signature(self, effect: RigEffect, theta: Theta) -> Signature:
        """Return what an effect leaves in the normalised innovations."""
        key = effect.name, theta
        if key not in self._made:
            self.make(effect, [theta])
        return self._made[key]

    def make(self, effect: RigEffect, thetas: Sequence[Theta]) -> None:
        """Compute signatures at many nonlinear parameters in one pass of the filter."""
        _, h, phi = self.columns_of(effect)
        width = h.shape[2]
        if effect.step:
            after = [(self.elapsed_s > t)[:, None, None].astype(float) for (t,) in thetas]
            h = np.concatenate([h * a for a in after], axis=2)
            phi = np.concatenate([phi * a for a in after], axis=2)
        seen = signatures(self.found.steps, self.gains, h, phi)
        sigma = np.sqrt(self.found.filtered.variance[self.kept])
        flat = seen[self.kept] / sigma[:, None]
        for k, theta in enumerate(thetas):
            columns = flat[:, k * width : (k + 1) * width]
            self._made[effect.name, theta] = Signature(columns=np.ascontiguousarray(columns))

    def candidate(self, effect: RigEffect) -> Candidate:
        """Return an effect as a candidate."""
        if effect.step is None:
            return Candidate(name=effect.name, signature=lambda theta: self.signature(effect, ()))
        last = float(self.elapsed_s[-1])
        times = np.round(np.linspace(EDGE_S, last - EDGE_S, STEP_TIMES), 3)
        grid = tuple((float(t),) for t in times)
        apart = float(times[1] - times[0])
        offsets = np.arange(-FINER, FINER + 1) / FINER * apart

        def finer(theta: Theta) -> tuple[Theta, ...]:
            near = tuple((float(t),) for t in theta[0] + offsets if 0.0 < t < last)
            self.make(effect, near)
            return near

        self.make(effect, grid)
        return Candidate(
            name=effect.name,
            signature=lambda theta: self.signature(effect, theta),
            grid=grid,
            finer=finer,
            event=True,
        )

    def problem(self) -> Problem:
        """Return the engine's problem."""
        found, steps = self.found, self.step_of
        filtered = found.filtered
        residual = filtered.innovation[self.kept] / np.sqrt(filtered.variance[self.kept])
        nothing = np.zeros((residual.size, 0))
        times = TimeBase(
            found.time_s[steps],
            found.cycle_of_step[steps],
            np.ones(residual.size),
            self.elapsed_s[steps],
        )
        return Problem(
            times=times,
            residual=residual,
            base=nothing,
            candidates=tuple(self.candidate(e) for e in self.effects),
            saturated=nothing,
            factors=rig_factors(self.run, self.cycles, found, steps, self.row_of),
            noise=NoiseShape(),
            sigma=1.0,
            events=frozenset(e.name for e in EFFECTS if e.step),
        )


def judged_rows(found: RigCalibration) -> tuple[int, ...]:
    """Return the rows to look at: those with noise, and those with a bound if it is exceeded.

    Across its axis the rig's movement is only bounded; within the bound these rows hold no white
    noise of a known size, beyond it they are what shows the mounting.
    """
    rows = rows_of_rig(found.steps.h.shape[1])
    seen = found.filtered.innovation**2 / found.filtered.variance
    beyond = [
        k for k in range(seen.shape[1]) if k not in rows.white and np.nanmean(seen[:, k]) > 1.0
    ]
    return tuple(sorted([*rows.white, *beyond]))


def _with_groups(sensors: SensorModel, groups: Sequence[str]) -> SensorModel:
    """Return a model of the same terms with those of further groups."""
    more = sensor_model(groups, t_ref_c=sensors.t_ref_c, gravity_m_s2=sensors.gravity_m_s2)
    channels = tuple(
        replace(old, model=replace(old.model, terms=(*old.model.terms, *new.model.terms)))
        for old, new in zip(sensors.channels, more.channels, strict=True)
    )
    return replace(sensors, channels=channels)


@dataclass(frozen=True, eq=False)
class RigSource:
    """Makes the problem of the rig filter with some effects added; each model runs once."""

    run: RigRun
    mode: Mode
    noise: RigNoise
    interval_s: float = 1.0
    t_ref_c: float = T_REF_C
    effects: tuple[RigEffect, ...] = EFFECTS
    _filters: dict[tuple[Choice, ...], FilterProblem] = field(
        default_factory=dict[tuple[Choice, ...], FilterProblem], repr=False
    )
    _problems: dict[tuple[Choice, ...], Problem] = field(
        default_factory=dict[tuple[Choice, ...], Problem], repr=False
    )

    @property
    def shown(self) -> tuple[RigEffect, ...]:
        """The effects for which the run holds what they need."""
        angle = self.mode == "precise"
        return tuple(e for e in self.effects if e.recorded(self.run, angle=angle))

    def problem(self, chosen: Sequence[Choice], shape: NoiseShape) -> Problem:
        """Return the problem of the enlarged filter, run anew."""
        del shape  # innovations are white
        key = _key(chosen)
        if key not in self._problems:
            self._problems[key] = self.filter_with(chosen).problem()
        return self._problems[key]

    def filter_with(self, chosen: Sequence[Choice]) -> FilterProblem:
        """Return the filter of the basic model with some effects."""
        key = _key(chosen)
        if key not in self._filters:
            names = {c.name for c in chosen}
            left = tuple(e for e in self.shown if e.name not in names)
            cycles = cycle_data(self.run, self.interval_s)
            found = self._calibrated(key)
            rows = self.filter_with(()).rows if key else judged_rows(found)
            self._filters[key] = FilterProblem(self.run, found, cycles, left, rows)
        return self._filters[key]

    def _calibrated(self, chosen: Sequence[Choice]) -> RigCalibration:
        effects = [BY_NAME[c.name] for c in chosen]
        steps = [
            bias_step(e.step, c.theta[0]) for c, e in zip(chosen, effects, strict=True) if e.step
        ]
        sensors = sensor_model(
            (*BASIC, *(g for e in effects for g in e.groups)),
            more=steps,
            t_ref_c=self.t_ref_c,
            gravity_m_s2=self.run.facts.site.gravity_m_s2,
        )
        prior = make_prior(sensors)
        if not any(e.name == "rig_mount" for e in effects):
            prior = replace(prior, mount_sigma_rad=0.0)
        return calibrate(
            self.run, self.mode, sensors=sensors, prior=prior, noise=self.noise,
            interval_s=self.interval_s, gate=NO_GATE,
        )  # fmt: skip


def _key(chosen: Sequence[Choice]) -> tuple[Choice, ...]:
    return tuple(sorted(chosen, key=lambda c: c.name))
