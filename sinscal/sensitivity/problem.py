"""The rig filter's innovations as the problem of the search for missing effects.

The innovations over their sigmas are white, of unit variance, when nothing is missing. What an
effect that the filter does not know would leave in them is had by sending its columns through the
same gains (Willsky and Jones 1976). An effect chosen joins the filter itself, which is iterated
anew: the enlarged model is verified by its own run, not by a regression.

With the rig's angle all its rows are looked at: what the filter takes up through a row that nobody
looks at is lost. Across the axis the noise assumed is a bound of the bearing's wobble, so these
rows count no more than the bound allows, and beside the harmonics that a wobble has.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.discrepancy.problem import Candidate, Factor, Problem, Signature, Theta
from errormodel.filter.gains import signatures
from errormodel.filter.steps import Steps, run_filter
from errormodel.linear import independent
from errormodel.noise.model import NoiseModel
from errormodel.noise.whitening import TimeBase
from errormodel.terms import Description
from sinscal.calibration.consistency import ALONG, FORCES, MeasurementRows, rows_of_rig
from sinscal.calibration.rig import RigCalibration
from sinscal.filter.data import CycleData
from sinscal.filter.steps import make_steps
from sinscal.library import rig_library
from sinscal.library.angle import MOUNTING
from sinscal.library.groups import TIME, RigEffect
from sinscal.model.priors import prior_sigma
from sinscal.model.sensors import SensorModel, sensor_model
from sinscal.recording.run import BoolArray, RigRun
from sinscal.sensitivity.factors import history, rig_factors, slow_hats

STEP_TIMES = 40  # of the grid of a jump's times
FINER = 12  # tried between a grid time and each of its neighbours
# Where less of an innovation's variance is the measurement's noise, the start is still being found.
SETTLED_SHARE = 0.5
BEARING_ORDERS = (2, 3, 4)  # harmonics of the rotation in which a bearing wobbles
EDGE_S = 30.0  # a jump nearer to an end of the run is no more than the start's own uncertainty


@dataclass(frozen=True, eq=False)
class FilterProblem:
    """One model's filter: its calibration and what effects would leave in its innovations."""

    run: RigRun
    found: RigCalibration
    cycles: tuple[CycleData, ...]
    effects: tuple[RigEffect, ...]
    _made: dict[tuple[str, Theta], Signature] = field(
        default_factory=dict[tuple[str, Theta], Signature], repr=False
    )

    @cached_property
    def steps(self) -> Steps:
        """The steps of the last pass, without what its gate refused."""
        found = self.found
        return replace(found.steps, z=np.where(self.kept, found.steps.z, np.nan))

    @cached_property
    def gains(self) -> FloatArray:
        """The gains of the last pass."""
        return run_filter(self.found.start, self.steps, with_gains=True).gains

    @cached_property
    def elapsed_s(self) -> FloatArray:
        """End of each step from the start of the run."""
        begin = np.array([c.measured.begin_s for c in self.cycles])
        numbers = np.maximum(np.append(self.found.cycle_of_step[1:], -1), self.found.cycle_of_step)
        return begin[numbers] + self.found.time_s

    @property
    def kept(self) -> BoolArray:
        """The innovations used, shape (K, m)."""
        return self.found.filtered.used

    @property
    def settled(self) -> BoolArray:
        """Mask of the innovations that are mainly the noise of their measurement, shape (K, m)."""
        share = self.found.steps.r / np.where(self.kept, self.found.filtered.variance, np.inf)
        return share > SETTLED_SHARE

    @cached_property
    def step_of(self) -> IntArray:
        """The step of each innovation used."""
        return np.nonzero(self.kept)[0]

    @cached_property
    def row_of(self) -> IntArray:
        """The row of each innovation used."""
        return np.nonzero(self.kept)[1]

    @property
    def rows(self) -> MeasurementRows:
        """The rows of measurements: their names, and which of them hold white noise."""
        return rows_of_rig(self.found.steps.h.shape[1])

    def bearing(self) -> FloatArray:
        """Return what the bearing's wobble may do: harmonics of the rows across the axis.

        In every cycle its own, from the second on: the first is how the SINS is mounted. Without
        them a wobble within its bound would be something that follows the rotation.
        """
        found = self.found
        across = [k for k in range(len(self.rows.names)) if k not in self.rows.white]
        if not across:
            return np.zeros((int(self.kept.sum()), 0))
        turned = history(self.cycles, found)[0]
        waves = [f(k * turned) for k in BEARING_ORDERS for f in (np.sin, np.cos)]
        mine = [found.cycle_of_step == c for c in range(len(self.cycles))]
        columns = np.column_stack([w * m for m in mine for w in waves])
        h = np.zeros((turned.size, len(self.rows.names), len(across) * columns.shape[1]))
        for i, row in enumerate(across):
            h[:, row, i * columns.shape[1] : (i + 1) * columns.shape[1]] = columns
        return self.normalised(h, np.zeros((turned.size, found.steps.phi.shape[1], h.shape[2])))

    def drifts(self) -> Factor:
        """Return what slow drifts of the constant errors leave, of the one kind or the other.

        Sent through the gains, as an effect is: a drift of the gyros shows long after it was.
        """
        hats = slow_hats(self.cycles, self.found)
        groups: list[FloatArray] = []
        for effect in (e for e in rig_library().effects if e.step):
            _, h, phi = self.columns_of(effect)
            columns = [
                (a[:, :, :, None] * hats[:, None, None, :]).reshape(*a.shape[:2], -1)
                for a in (h, phi)
            ]
            groups.append(self.normalised(*columns))
        return Factor(name=TIME, groups=tuple(groups), repeatable=False)

    def normalised(self, h: FloatArray, phi: FloatArray) -> FloatArray:
        """Return what columns of measurements and motion leave in the normalised innovations."""
        seen = signatures(self.steps, self.gains, h, phi)
        sigma = np.sqrt(self.found.filtered.variance[self.kept])
        return seen[self.kept] / sigma[:, None]

    @cached_property
    def _wider(self) -> tuple[Steps, tuple[str, ...], tuple[Description, ...]]:
        """The steps about the same nominal of a model that has every effect's parameters.

        With them the names of its states, and what those of the effects are.
        """
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
        described = (*MOUNTING, *sensors.parameters.values())
        return steps, layout.names, tuple(one for one in described if one.name in layout.names)

    def columns_of(self, effect: RigEffect) -> tuple[list[str], FloatArray, FloatArray]:
        """Return an effect's unknowns, and how each enters measurements and motion."""
        steps, names, _ = self._wider
        names_of = [one.name for one in self._parameters_of(effect)]
        places = [names.index(n) for n in names_of]
        return names_of, steps.h[:, :, places], steps.phi[:, :, places]

    def _parameters_of(self, effect: RigEffect) -> list[Description]:
        """Return an effect's parameters; of a step and a drift, the constant errors' own."""
        _, _, described = self._wider
        if effect.step or effect.drift:
            return [one for one in described if one.group == effect.constant_error]
        return [one for one in described if effect.owns(one)]

    def prior_sigmas(self, effect: RigEffect, given: Mapping[str, float] = {}) -> FloatArray:
        """Return how large an effect's parameters are expected to be, in the order of its columns.

        Sigmas by group or name that are `given` go before the library's.
        """
        return np.array([prior_sigma(one, given) for one in self._parameters_of(effect)])

    def unit_of(self, effect: RigEffect) -> str:
        """Return the unit of an effect's first unknown."""
        return self._parameters_of(effect)[0].unit

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
            after = [self.share_after(t)[:, None, None] for (t,) in thetas]
            h = np.concatenate([h * a for a in after], axis=2)
            phi = np.concatenate([phi * a for a in after], axis=2)
        flat = self.normalised(h, phi)
        for k, theta in enumerate(thetas):
            columns = flat[:, k * width : (k + 1) * width]
            self._made[effect.name, theta] = Signature(columns=np.ascontiguousarray(columns))

    def share_after(self, at_s: float) -> FloatArray:
        """Return which share of every step lies after a time, shape (K,)."""
        length = np.diff(self.elapsed_s, prepend=0.0)
        length[self.found.cycle_of_step < 0] = 0.0  # what begins a cycle takes no time
        since = self.elapsed_s - at_s
        inside = np.divide(since, length, out=np.sign(since), where=length > 0.0)
        return np.clip(inside, 0.0, 1.0)

    def candidate(self, effect: RigEffect) -> Candidate:
        """Return an effect as a candidate."""
        if effect.step is None:
            return Candidate(name=effect.name, signature=lambda theta: self.signature(effect, ()))
        first, last = self._span_s
        times = np.round(np.linspace(first + EDGE_S, last - EDGE_S, STEP_TIMES), 3)
        grid = tuple((float(t),) for t in times)
        apart = float(times[1] - times[0])

        def finer(theta: Theta) -> tuple[Theta, ...]:
            best = self._best(effect, self._about(theta, apart))
            return self._about(best, apart / FINER)

        self.make(effect, grid)
        return Candidate(
            name=effect.name,
            signature=lambda theta: self.signature(effect, theta),
            grid=grid,
            finer=finer,
            event=True,
        )

    @property
    def _span_s(self) -> tuple[float, float]:
        """Begin and end on the clock of the whole run, of which this may be some cycles."""
        return float(self.elapsed_s[0]), float(self.elapsed_s[-1])

    def _about(self, theta: Theta, apart: float) -> tuple[Theta, ...]:
        """Return times about one of a jump."""
        offsets = np.arange(-FINER, FINER + 1) / FINER * apart
        first, last = self._span_s
        return tuple((float(t),) for t in theta[0] + offsets if first < t < last)

    def _gains(self, effect: RigEffect, thetas: Sequence[Theta]) -> FloatArray:
        """Return how much chi-square an effect explains at some nonlinear parameters."""
        self.make(effect, thetas)
        bases = [independent(self.signature(effect, theta).columns) for theta in thetas]
        return np.array([float(np.sum((b.T @ self.residual) ** 2)) for b in bases])

    def _best(self, effect: RigEffect, thetas: Sequence[Theta]) -> Theta:
        return thetas[int(np.argmax(self._gains(effect, thetas)))]

    def time_sigma_s(self, effect: RigEffect, theta: Theta) -> float:
        """Return how well the time of a jump is known, by the likelihood of the times about it."""
        first, last = self._span_s
        apart = (last - first - 2.0 * EDGE_S) / (STEP_TIMES - 1)
        while True:
            thetas = self._about(theta, apart)
            gains = self._gains(effect, thetas)
            weight = np.exp(0.5 * (gains - gains.max()))
            times = np.array([t for (t,) in thetas])
            mean = float(weight @ times / weight.sum())
            sigma = float(np.sqrt(weight @ (times - mean) ** 2 / weight.sum()))
            if sigma > 2.0 * apart / FINER or apart < 0.1:
                return max(sigma, apart / FINER)
            apart /= FINER

    @property
    def residual(self) -> FloatArray:
        """The normalised innovations."""
        filtered = self.found.filtered
        return filtered.innovation[self.kept] / np.sqrt(filtered.variance[self.kept])

    def problem(self) -> Problem:
        """Return the engine's problem."""
        found, steps, residual = self.found, self.step_of, self.residual
        factors = (
            *rig_factors(self.run, self.cycles, found, steps, self.row_of),
            self.drifts(),
        )
        times = TimeBase(
            found.time_s[steps],
            found.cycle_of_step[steps],
            np.ones(residual.size),
            self.elapsed_s[steps],
        )
        return Problem(
            times=times,
            residual=residual,
            base=self.bearing(),
            candidates=tuple(self.candidate(e) for e in self.effects),
            saturated=self._everything(factors),
            factors=factors,
            noise=NoiseModel(),
            events=frozenset(e.name for e in rig_library().effects if e.step),
            bounded=~np.isin(self.row_of, self.rows.white),
            scaled=self._noisy(),
        )

    def _everything(self, factors: Sequence[Factor]) -> FloatArray:
        """Return the columns of all that may be missing; jumps are among the slow drifts."""
        effects = [self.signature(e, ()).columns for e in self.effects if e.step is None]
        return np.hstack([*effects, *(g for f in factors for g in f.groups)])

    def _noisy(self) -> tuple[BoolArray, ...]:
        """Return which innovations are the accelerometers' noise, and which the rig's angle's."""
        names, settled = self.rows.names, self.settled[self.kept]
        groups = (FORCES, (ALONG,)) if ALONG in names else (FORCES,)
        return tuple(
            settled & np.isin(self.row_of, [names.index(name) for name in group])
            for group in groups
        )


def _with_groups(sensors: SensorModel, groups: Sequence[str]) -> SensorModel:
    """Return a model of the same terms with those of further groups."""
    more = sensor_model(groups, t_ref_c=sensors.t_ref_c, gravity_m_s2=sensors.gravity_m_s2)
    channels = tuple(
        replace(old, model=replace(old.model, terms=(*old.model.terms, *new.model.terms)))
        for old, new in zip(sensors.channels, more.channels, strict=True)
    )
    return replace(sensors, channels=channels)
