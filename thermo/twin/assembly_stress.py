"""Stress that assembly leaves in an emulated accelerometer and thermal cycling relaxes.

The residual stress s is 1 after assembly. It falls with every degree the temperature travels,
whichever way, and a little with time at temperature (Arrhenius); each slip that relaxes it leaves
a kick of its own, the smaller the less stress is left. Bias and scale factor follow the stress:
two terms with a memory, so that they drive an emulated accelerometer as any other effect does.
"""

import zlib
from dataclasses import dataclass
from functools import partial

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Coefficient, Memory, Place, Term, Values, by_run

BIAS, SCALE = "assembly_stress_bias", "assembly_stress_scale"
CYCLE_TRAVEL_C = 220.0  # of a cycle from −40 to +70 °C and back
SLIP_TRAVEL_C = 55.0  # assumed: four slips in such a cycle
T_REF_K = 298.15
BOLTZMANN_EV_K = 8.617333e-5
HOT_C = 70.0  # where the time constant at temperature is given


@dataclass(frozen=True, slots=True, kw_only=True)
class AssemblyStress:
    """The run-in state of one accelerometer; every default is assumed.

    Attributes
    ----------
    bias_ug, scale_ppm : float
        By how much bias and scale factor are off right after assembly. Assumed, some twice and
        once a year's composite repeatability of navigation-grade units (160 µg and 310 ppm, from
        memory of data sheets).
    cycles : float
        Cycles of −40…+70 °C in which the stress falls to 1/e.
    kick_share : float
        Standard deviation of the kicks of one such cycle, as a share of the stress that is left.
    hot_hours : float
        Hours at 70 °C in which the stress falls to 1/e without any cycling.
    activation_ev : float
        How much slower that is at lower temperatures.
    seed : int
        Of the kicks.
    """

    bias_ug: float = 300.0
    scale_ppm: float = 300.0
    cycles: float = 2.5
    kick_share: float = 0.1
    hot_hours: float = 1000.0
    activation_ev: float = 0.7
    seed: int = 1

    def terms(self) -> tuple[Term, Term]:
        """Return the terms to append to an accelerometer's true model."""
        bias = Coefficient(name=BIAS, symbol="A0", unit="µg", per_unit=1e6)
        scale = Coefficient(name=SCALE, symbol="A1", unit="ppm", per_unit=1e6)
        return self._term(bias, "input", 0), self._term(scale, "scale", 1)

    def values(self) -> dict[str, float]:
        """Return the coefficients of `terms`, in the model's unit."""
        return {BIAS: 1e-6 * self.bias_ug, SCALE: 1e-6 * self.scale_ppm}

    def _term(self, coefficient: Coefficient, place: Place, stream: int) -> Term:
        return Term(
            name=coefficient.name,
            sentence="Residual stress from assembly relaxes with every thermal cycle.",
            place=place,
            coefficients=(coefficient,),
            columns=by_run(partial(_relaxed, self, stream)),
            needs=frozenset(["x_slow_c"]),
            predictive=False,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _State:
    """Memory of a term: the last reading, the travel so far, ln s, and the sum of kicks."""

    time_s: float
    x_c: float
    travel_c: float = 0.0
    log_stress: float = 0.0
    kicked: float = 0.0


def _relaxed(
    stress: AssemblyStress, stream: int, record: Record, readings: slice, _: Values, memory: Memory
) -> tuple[FloatArray, Memory]:
    """Return stress and kicks at the readings of one run, shape (n,)."""
    time_s, x = record.time_s[readings], record["x_slow_c"][readings]
    state: _State = memory or _State(time_s=float(time_s[0]), x_c=float(x[0]))
    column = np.empty(x.size)
    for k in range(x.size):
        state = _moved(stress, stream, state, float(time_s[k]), float(x[k]))
        column[k] = np.exp(state.log_stress) + state.kicked
    return column, state


def _moved(
    stress: AssemblyStress, stream: int, before: _State, time_s: float, x_c: float
) -> _State:
    moved_c = abs(x_c - before.x_c)
    # a run's time may begin anew: what lies between two runs then does not count as time
    hours = max(time_s - before.time_s, 0.0) / 3600.0
    log_stress = before.log_stress - moved_c / (stress.cycles * CYCLE_TRAVEL_C)
    log_stress -= hours / _hours_at(stress, x_c)
    travel_c, kicked = before.travel_c + moved_c, before.kicked
    size = stress.kick_share * np.sqrt(SLIP_TRAVEL_C / CYCLE_TRAVEL_C) * np.exp(log_stress)
    for slip in range(int(before.travel_c / SLIP_TRAVEL_C), int(travel_c / SLIP_TRAVEL_C)):
        rng = np.random.default_rng([stress.seed, stream, slip])
        kicked += float(size * rng.standard_normal())
    return _State(time_s=time_s, x_c=x_c, travel_c=travel_c, log_stress=log_stress, kicked=kicked)


def _hours_at(stress: AssemblyStress, x_c: float) -> float:
    """Return the time constant at a temperature, hours; `x_c` is from 25 °C."""
    inverse = 1.0 / (T_REF_K + x_c) - 1.0 / (T_REF_K - 25.0 + HOT_C)
    return float(stress.hot_hours * np.exp(stress.activation_ev / BOLTZMANN_EV_K * inverse))


def assembly_stress(serial: str, *, seed: int = 1) -> AssemblyStress:
    """Draw the stress of a newly assembled accelerometer, the same for the same serial.

    All spreads are assumed: 30 % of size with either sign, 25 % of the number of cycles.
    """
    rng = np.random.default_rng([seed, zlib.crc32(serial.encode()), 2])
    usual = AssemblyStress()
    spread = np.exp([0.3, 0.3, 0.25] * rng.standard_normal(3))
    signs = rng.choice([-1.0, 1.0], size=2)
    return AssemblyStress(
        bias_ug=usual.bias_ug * float(signs[0] * spread[0]),
        scale_ppm=usual.scale_ppm * float(signs[1] * spread[1]),
        cycles=usual.cycles * float(spread[2]),
        seed=int(rng.integers(2**31)),
    )
