"""One pass of the rig filter over all cycles, repeated until the nominal no longer moves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.kalman import State, initial_state
from errormodel.filter.steps import NO_GATE, Filtered, Steps, run_filter
from sinscal.filter.alignment import find_north, found_azimuth, level_nominal
from sinscal.filter.data import CycleData, Nominal, RigNoise
from sinscal.filter.layout import RigLayout
from sinscal.filter.reach import intervals_within_reach
from sinscal.filter.steps import make_steps, remeasured
from sinscal.frames.attitude import rotation, rotvec_of
from sinscal.model.priors import RigPrior
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import RigFacts

MAX_ITERATIONS = 20
# Iteration ends when no unknown moves by more than this share of its sigma.
STEP_SIGMAS = 0.02
# North is sought only until nothing moves by more than this: the next filter goes on from there.
ROUGHLY_SIGMAS = 0.3
# Once the nominal moves by less, the derivatives stay: after three sigmas attitudes and sensors are
# another by 1e-4, and so are derivatives; estimates differ by less than 1e-3 of their sigmas.
CHORD_SIGMAS = 3.0
# A gate that closes stays open for innovations up to this share of the largest that were used: a
# shock of 10⁴ sigmas moves others by less, and six passes close the gate.
CLOSING = 0.3
# Where the gate refuses a larger share of what was measured, that are no outliers: the model is
# wrong, and the gate stays open, so that the estimates are those of all readings alike.
MOST_REFUSED = 0.05


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pass:
    """The last pass: its linearisation point, its steps and the filter's result."""

    nominal: Nominal
    start: State
    steps: Steps
    filtered: Filtered
    iterations: int
    converged: bool


def _moved(state: State, layout: RigLayout) -> float:
    """Return the largest step of a constant in its sigmas."""
    x, sigma = state.x[layout.moving :], state.sigmas[layout.moving :]
    free = sigma > 0.0
    return float(np.max(np.abs(x[free]) / sigma[free]))


def spread_of(filtered: Filtered) -> float:
    """Return the sigma of the normalised innovations, all of them, by their median: 1 is right."""
    seen = np.isfinite(filtered.innovation)
    size = np.abs(filtered.innovation[seen]) / np.sqrt(filtered.variance[seen])
    return float(np.median(size)) / 0.6745


def farthest(filtered: Filtered) -> float:
    """Return how many sigmas the largest innovation has of those that were used."""
    size = np.abs(filtered.innovation) / np.sqrt(filtered.variance)
    return float(np.max(size, where=filtered.used, initial=0.0))


def refused_share(filtered: Filtered) -> float:
    """Return which share of the measurements the gate refused."""
    seen = np.isfinite(filtered.innovation)
    return 1.0 - float(np.sum(filtered.used & seen)) / max(float(np.sum(seen)), 1.0)


def iterated(
    nominal: Nominal,
    layout: RigLayout,
    steps_about: Callable[[Nominal, Steps | None], Steps],
    start_about: Callable[[Nominal], State],
    gate: float,
    enough: float,
) -> Pass:
    """Filter, improve the nominal, and again, until nothing moves by `enough` sigmas.

    Derivatives are those of the first nominal from which little moves (`CHORD_SIGMAS`).

    Parameters
    ----------
    nominal : Nominal
        To begin with.
    layout : RigLayout
    steps_about : callable
        Gives the filter's steps about a nominal, with the derivatives of other steps if there are
        some.
    start_about : callable
        Gives what the filter starts from, about a nominal.
    gate : float
        Closed when the nominal is good: innovations beyond so many sigmas are refused.
    enough : float
    """
    steps = steps_about(nominal, None)
    count, limit = 0, np.inf
    while True:
        start = start_about(nominal)
        filtered = run_filter(start, steps, gate=limit)
        if refused_share(filtered) > MOST_REFUSED:
            gate = limit = NO_GATE
            filtered = run_filter(start, steps, gate=limit)
        moved = _moved(filtered.state, layout)
        converged = moved < enough and limit == gate
        if converged or count >= MAX_ITERATIONS:
            return Pass(
                nominal=nominal,
                start=start,
                steps=steps,
                filtered=filtered,
                iterations=count,
                converged=converged,
            )
        count += 1
        if moved >= enough:
            nominal = nominal.improved(filtered.state.x, layout)
            steps = steps_about(nominal, steps if moved < CHORD_SIGMAS else None)
        if moved < enough or limit < np.inf:
            # the gate closes as far as what is left of outliers and of the linearisation allows,
            # the farthest outliers first: while they count, what is right seems to be wrong
            limit = max(gate * max(1.0, 0.8 * spread_of(filtered)), CLOSING * farthest(filtered))
            limit = gate if limit < 1.05 * gate else limit


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigFilter:
    """The rig filter of one run: its data, its sensors, and what is known beforehand."""

    facts: RigFacts
    cycles: Sequence[CycleData]
    sensors: SensorModel
    prior: RigPrior
    noise: RigNoise

    def layout(self, *, wander: bool = False, angle: bool = False) -> RigLayout:
        """Return the states of a pass."""
        return RigLayout(
            cycles=len(self.cycles),
            parameters=self.sensors.names,
            drift=self.noise.drifts,
            counted=self.noise.accel_quantum > 0.0,
            wander=wander,
            angle=angle,
            remount=angle and self.prior.remount_sigma_rad > 0.0,
        )

    def find_north(self, interval_s: float, gate: float = NO_GATE) -> tuple[Nominal, FloatArray]:
        """Level, then gyrocompass: iterate in axes of any azimuth, and turn them to north.

        The data are taken at a lower rate: the filter that follows takes them at their own. They
        are taken in from the start of each cycle as far as the attitude can be carried
        (`sinscal.filter.reach`).
        """
        site = self.facts.site
        layout = self.layout(wander=True)
        rough = self.thinned(interval_s)
        nominal = level_nominal(rough.cycles, self.sensors, self.prior.values, site)
        cov, taken = rough.start(nominal, nominal, layout).cov, 0
        longest = max(c.first.size for c in rough.cycles) - 1
        while True:
            steps = rough.steps(nominal, layout)
            taken = intervals_within_reach(steps, layout, cov, taken)
            part = replace(rough, cycles=[c.beginning(taken) for c in rough.cycles])
            ended = part.iterate(nominal, layout, gate, ROUGHLY_SIGMAS)
            found = ended.filtered.state
            nominal, cov = ended.nominal.improved(found.x, layout), found.cov
            if taken == longest:
                break
        north = find_north(nominal, cov, layout, site)
        return north.nominal, north.sigma_rad

    def thinned(self, interval_s: float) -> "RigFilter":
        """Return the filter on the data at a lower rate, for a nominal to begin with."""
        return replace(self, cycles=[c.thinned(interval_s) for c in self.cycles])

    def improved(self, nominal: Nominal, layout: RigLayout, gate: float) -> Nominal:
        """Return a nominal iterated until nothing moves by much."""
        ended = self.iterate(nominal, layout, gate, ROUGHLY_SIGMAS)
        return ended.nominal.improved(ended.filtered.state.x, layout)

    def with_platform(self, nominal: Nominal) -> Nominal:
        """Return the nominal with the platform's attitude at angle zero, from the first minute."""
        bases: list[FloatArray] = []
        for k, cycle in enumerate(self.cycles):
            assert cycle.angle is not None
            assert cycle.axis is not None
            unit = np.eye(3)[cycle.axis]
            back = rotation(-float(cycle.angle[0]) * unit)
            early = cycle.measured.take(slice(2))
            true = self.sensors.corrected(early, nominal.values)
            first = rotation(true.w[0] * true.step_s[0])
            bases.append(nominal.c_start[k] @ first @ back)
        return replace(
            nominal,
            base=tuple(bases),
            remount=tuple(np.zeros(3) for _ in self.cycles),
        )

    def iterate(self, nominal: Nominal, layout: RigLayout, gate: float, enough: float) -> Pass:
        """Filter, improve the nominal, and again, until nothing moves by `enough` sigmas."""
        anchor = nominal
        return iterated(
            nominal,
            layout,
            lambda now, chord: self.steps(now, layout, chord),
            lambda now: self.start(now, anchor, layout),
            gate,
            enough,
        )

    def steps(self, nominal: Nominal, layout: RigLayout, chord: Steps | None = None) -> Steps:
        """Return the steps about a nominal, with the derivatives of `chord` if there is one."""
        gravity = self.facts.site.gravity_m_s2
        if chord is not None:
            return remeasured(chord, self.cycles, self.sensors, nominal, layout, gravity)
        return make_steps(self.cycles, self.sensors, nominal, layout, self.noise, gravity)

    def start(self, nominal: Nominal, anchor: Nominal, layout: RigLayout) -> State:
        """Return the state before all data: what is known beforehand, about the nominal."""
        prior, n = self.prior, layout.size
        x, cov = np.zeros(n), np.zeros((n, n))
        unknown = layout.unknowns
        x[unknown] = prior.values - nominal.values
        cov[unknown, unknown] = prior.cov
        if layout.drift:
            for first, sensor in ((3, self.noise.of_gyro), (6, self.noise.of_accel)):
                cov[first : first + 3, first : first + 3] = np.eye(3) * sensor.drift**2
        for k in range(layout.cycles):
            self._start_cycle(x, cov, nominal, anchor, layout, k)
        if not layout.wander:
            self._azimuth_prior(x, cov, nominal, layout)
        if layout.angle:
            place = layout.mount
            x[place] = -nominal.mount
            cov[place, place] = np.eye(3) * prior.mount_sigma_rad**2
        return initial_state(x, cov)

    def _start_cycle(
        self,
        x: FloatArray,
        cov: FloatArray,
        nominal: Nominal,
        anchor: Nominal,
        layout: RigLayout,
        k: int,
    ) -> None:
        prior = self.prior
        place = layout.start(k)
        sigmas = np.full(3, prior.start_sigma_rad)
        if layout.wander:
            sigmas[2] = 0.0  # the azimuth of the axes is what it is
            rate = layout.earth_rate(k)
            x[rate] = -nominal.earth[k][:2]
            cov[rate, rate] = np.eye(2) * self.facts.site.earth_rate[1] ** 2
        elif prior.azimuth_sigma_rad is not None:
            sigmas[2] = prior.azimuth_sigma_rad
        cov[place, place] = np.diag(sigmas**2)
        if layout.angle:
            base = layout.base(k)
            x[base] = rotvec_of(anchor.base[k] @ nominal.base[k].T)
            cov[base, base] = np.eye(3) * prior.base_sigma_rad**2
        if layout.angle and layout.remount:
            more = layout.remounted(k)
            x[more] = -nominal.remount[k]
            cov[more, more] = np.eye(3) * prior.remount_sigma_rad**2

    def _azimuth_prior(
        self, x: FloatArray, cov: FloatArray, nominal: Nominal, layout: RigLayout
    ) -> None:
        """Put in the azimuth of the rotation axis when it is given: one error for all cycles.

        The axis in the body is as the gyros say, so it depends on their errors.
        """
        facts = self.facts
        if facts.azimuth_rad is None:
            return
        up = np.array([layout.start(k).start + 2 for k in range(layout.cycles)])
        by = np.zeros((len(up), len(self.sensors.names)))
        for k, cycle in enumerate(self.cycles):
            found, by[k] = found_azimuth(cycle, self.sensors, nominal.values, nominal.c_start[k])
            apart = facts.azimuth_rad - found
            x[up[k]] = -((apart + np.pi) % (2.0 * np.pi) - np.pi)
        unknown = layout.unknowns
        x[up] += by @ x[unknown]
        cov[up, unknown] = by @ self.prior.cov
        cov[unknown, up] = cov[up, unknown].T
        cov[np.ix_(up, up)] = facts.azimuth_sigma_rad**2 + by @ self.prior.cov @ by.T
