"""Cycles of newly assembled accelerometers, as fast as their own state model can be computed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from thermo.run_in.judge import judge_run_in
from thermo.run_in.relaxation import CoefficientSeries, cycles_needed
from thermo.twin.assembly_stress import AssemblyStress, assembly_stress

CYCLES = 60
SIGMA = 2.0  # µg and ppm: what a run of some hours gives with 3 µg of drift correlated over one
LIMIT = 15.0
Law = Callable[[int], FloatArray]


def cycling(cycles: int, per_cycle: int = 24) -> Record:
    """Two hours a cycle, −40 to +70 °C and back; temperatures from 25 °C."""
    k = np.arange(1, cycles * per_cycle + 1)
    phase = (k / per_cycle) % 1.0
    x = np.where(phase < 0.5, -65 + 220 * phase, -65 + 220 * (1 - phase))
    return Record(time_s=300.0 * k, signals={"x_slow_c": x})


def state(stress: AssemblyStress, record: Record) -> FloatArray:
    """What is off in bias (µg) and scale factor (ppm), shape (2, n)."""
    values = stress.values()
    columns = [t.columns(record, {}, None)[0][:, 0] * values[t.name] for t in stress.terms()]
    return 1e6 * np.array(columns)


def assembled(seed: int) -> FloatArray:
    """The mean of each cycle of an emulated accelerometer, shape (2, CYCLES)."""
    path = state(assembly_stress(f"S{seed}", seed=seed), cycling(CYCLES))
    return path.reshape(2, CYCLES, -1).mean(axis=2)


def stretched(seed: int) -> FloatArray:
    """Another law: exp(−(k/κ)^0.6), which the judgement does not know."""
    kappa = np.random.default_rng(seed).uniform(1, 3)
    return 160 * np.exp(-((np.arange(CYCLES) / kappa) ** 0.6)) * np.ones((2, 1))


def hyperbolic(seed: int) -> FloatArray:
    """1/(1 + k/κ): most of the change comes late."""
    kappa = np.random.default_rng(seed).uniform(1, 3)
    return 160 / (1 + np.arange(CYCLES) / kappa) * np.ones((2, 1))


def series_of(
    truth: FloatArray, rng: np.random.Generator, sigma: float = SIGMA
) -> list[CoefficientSeries]:
    measured = truth + sigma * rng.standard_normal(truth.shape)
    return [
        CoefficientSeries(
            name=name, unit=unit, values=y, sigmas=np.full(y.size, sigma), limit=LIMIT
        )
        for name, unit, y in zip(("k0", "k1"), ("µg", "ppm"), measured, strict=True)
    ]


@dataclass(frozen=True, kw_only=True)
class Stopped:
    """How one run-in ended: at which cycle, where it could have, what changed afterwards."""

    at: int
    could_have: int
    change_after: float
    before: float
    after: float

    @property
    def right(self) -> bool:
        return self.change_after <= LIMIT

    @property
    def late(self) -> int:
        return self.at - self.could_have


def run_in(law: Law, seed: int, sigma: float = SIGMA) -> Stopped:
    """Cycle until the rule stops, from the fourth cycle on; four more give what is after."""
    truth = law(seed)
    series = series_of(truth, np.random.default_rng([seed, 7]), sigma)
    for cycles in range(4, CYCLES - 4):
        if judge_run_in("S", [s.first(cycles) for s in series]).settled:
            break
    k0 = series[0].values
    return Stopped(
        at=cycles,
        could_have=int(cycles_needed(truth, LIMIT).max()) + 1,
        change_after=float(np.max(np.abs(truth[:, cycles:] - truth[:, [cycles - 1]]))),
        before=float(np.std(k0[:4], ddof=1)),
        after=float(np.std(k0[cycles : cycles + 4], ddof=1)),
    )
