"""Terms that depend on time, on the run, on the head or on the readout, for missing effects.

Signals besides those of `thermo.library.terms`: `elapsed_h`, hours since the first run began (from
the recorded starts of the runs, or with the runs laid end to end where these are not known).
"""

from collections.abc import Callable

import numba
import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import (
    Coefficient,
    Effect,
    InputChange,
    Memory,
    Parameter,
    Term,
    Values,
    by_run,
    memoryless,
)

MICRO = 1e6
MAX_RUNS = 12  # whose turn-on offsets have names
MAX_MOUNTINGS = 5  # whose angles have names
# Play radii of a loop of many hysterons, °C: from hardly a loop to half the widest chamber range.
PLAY_RADII_C = (1.5, 4.0, 9.0, 18.0, 36.0)


def _coefficient(name: str, symbol: str, unit: str) -> Coefficient:
    return Coefficient(name=name, symbol=symbol, unit=unit, per_unit=MICRO, min_share=1e-3)


def run_in() -> Term:
    """Return a bias that relaxes over the campaign."""
    return Term(
        name="run_in",
        sentence="Stress from assembly relaxes: the bias dies away over the campaign.",
        place="input",
        coefficients=(_coefficient("run_in", "A", "µg"),),
        columns=lambda r, v, m: (np.exp(-r["elapsed_h"] / v["run_in_tau_h"])[:, None], m),
        needs=frozenset(["elapsed_h"]),
        parameters=(
            Parameter(name="run_in_tau_h", symbol="τ", unit="h", lo=0.2, hi=200.0, start=5.0),
        ),
        predictive=False,
    )


def warm_up() -> Term:
    """Return a bias that dies away after each power-on, which a run's start is taken for."""
    return Term(
        name="warm_up",
        sentence="The bias dies away after each power-on while the accelerometer warms itself.",
        place="input",
        coefficients=(_coefficient("warm_up", "W", "µg"),),
        columns=lambda r, v, m: (np.exp(-r.time_s / v["warm_up_tau_s"])[:, None], m),
        parameters=(
            Parameter(name="warm_up_tau_s", symbol="τw", unit="s", lo=30.0, hi=14400.0, start=1200),
        ),
    )


def turn_on_offset(number: int) -> Term:
    """Return the offset of run `number` (1 for the second run) from the first."""
    name = f"turn_on_offset_{number}"
    return Term(
        name=name,
        sentence="The bias takes a new value at each power-on.",
        place="input",
        coefficients=(_coefficient(name, f"u{number}", "µg"),),
        columns=memoryless(lambda r: (r.run == number).astype(float)),
        predictive=False,
    )


def bias_step() -> Term:
    """Return a step of the bias at one time."""
    return Term(
        name="bias_step",
        sentence="The bias stepped once and stayed.",
        place="input",
        coefficients=(_coefficient("bias_step", "J", "µg"),),
        columns=lambda r, v, m: (
            (r["elapsed_h"] >= v["bias_step_at_h"]).astype(float)[:, None],
            m,
        ),
        needs=frozenset(["elapsed_h"]),
        parameters=(
            Parameter(name="bias_step_at_h", symbol="t", unit="h", lo=0.0, hi=1e4, start=1.0),
        ),
        predictive=False,
    )


def bias_drift() -> Term:
    """Return a bias that changes uniformly over the campaign."""
    return Term(
        name="bias_drift",
        sentence="The bias changes uniformly with time over the campaign.",
        place="input",
        coefficients=(_coefficient("bias_drift", "D", "µg/h"),),
        columns=memoryless(lambda r: r["elapsed_h"]),
        needs=frozenset(["elapsed_h"]),
        predictive=False,
    )


def indexer_harmonic(order: int) -> Term:
    """Return an error of the head's angle with `order` periods a turn."""
    name = "indexer_harmonic" if order == 2 else f"indexer_harmonic_{order}"

    def columns(record: Record) -> FloatArray:
        own = np.arctan2(record["a_i_g"], record["a_p_g"])
        # the error is the head's own, however the accelerometer is mounted on it
        head_deg = record.signals.get("head_deg")
        angle = order * (own if head_deg is None else np.deg2rad(head_deg))
        error = np.column_stack([np.sin(angle), np.cos(angle)])
        return np.round(record["a_p_g"][:, None] * error, 12)  # what is zero shall be zero

    return Term(
        name=name,
        sentence=f"The head's angle errs with {order} periods a turn.",
        place="input",
        coefficients=(
            _coefficient(f"{name}_sin", "es", "µrad"),
            _coefficient(f"{name}_cos", "ec", "µrad"),
        ),
        columns=memoryless(columns),
        needs=frozenset(["a_i_g", "a_p_g"]),
    )


def foreseen(term: Term | InputChange) -> bool:
    """Tell whether a run's part of a term is known from the other runs of the same test.

    That of what does not belong to one run or moment, and of a mounting, which runs share.
    """
    return term.predictive or (isinstance(term, Term) and "mounting" in term.needs)


def remount(number: int) -> Term:
    """Return the angle by which mounting `number` misses the first, about the output axis."""
    return Term(
        name=f"remount_{number}",
        sentence="Mounted anew on the head, the accelerometer is turned by a small angle.",
        place="input",
        coefficients=(_coefficient(f"remount_{number}", f"m{number}", "µrad"),),
        columns=memoryless(lambda r: r["a_p_g"] * (r["mounting"] == number)),
        needs=frozenset(["a_p_g", "mounting"]),
        predictive=False,
    )


def _readout(
    name: str, symbol: str, unit: str, sentence: str, of_input: Callable[[FloatArray], FloatArray]
) -> Term:
    """Return a term of the readout, a function of the input."""
    return Term(
        name=name,
        sentence=sentence,
        place="input",
        coefficients=(_coefficient(name, symbol, unit),),
        columns=memoryless(lambda r: of_input(r["a_i_g"])),
        needs=frozenset(["a_i_g"]),
    )


def output_asymmetry() -> Term:
    """Return a scale factor that differs between positive and negative output."""
    sentence = "The readout's gain differs between positive and negative output."
    return _readout("output_nonlinearity", "n1", "µg/g", sentence, np.abs)


def output_bend() -> Term:
    """Return a gain that changes with the size of the output."""
    sentence = "The readout's gain changes with the size of its output."
    name = "output_nonlinearity_odd"
    return _readout(name, "n2", "µg/g²", sentence, lambda a: a * np.abs(a))


@numba.njit(cache=True)
def _play(x: FloatArray, radius: float, state: float) -> FloatArray:
    out = np.empty(x.size)
    for k in range(x.size):
        state = min(max(state, x[k] - radius), x[k] + radius)
        out[k] = state - x[k]
    return out


@numba.njit(cache=True)
def _travelled(x: FloatArray, last_x: float, path: float) -> FloatArray:
    out = np.empty(x.size)
    for k in range(x.size):
        path += abs(x[k] - last_x)
        last_x = x[k]
        out[k] = path
    return out


def loop_start(name: str, place: str, unit: str) -> Term:
    """Return what a loop's state before the run's start leaves: forgotten over its width."""
    own, width = f"{name}_start", f"{name}_width"

    def one_run(
        record: Record, readings: slice, values: Values, memory: Memory
    ) -> tuple[FloatArray, Memory]:
        x = record["x_slow_c"][readings]
        last_x, before = memory or (float(x[0]), 0.0)
        path = _travelled(x, last_x, before)
        return np.exp(-path / values[width]), (float(x[-1]), float(path[-1]))

    return Term(
        name=own,
        sentence="The run begins with the loop's state of what went before.",
        place="input" if place == "input" else "scale",
        coefficients=(_coefficient(own, "h0", unit),),
        columns=by_run(one_run),
        needs=frozenset(["x_slow_c"]),
    )


def loop_plays(name: str, place: str, unit: str) -> Term:
    """Return a loop of many hysterons: the Prandtl-Ishlinskii sum of plays of fixed radii."""
    own = f"{name}_plays"

    def one_run(
        record: Record, readings: slice, values: Values, memory: Memory
    ) -> tuple[FloatArray, Memory]:
        del values
        x = record["x_slow_c"][readings]
        before = memory or tuple(float(x[0]) for _ in PLAY_RADII_C)
        plays = [_play(x, r, s) for r, s in zip(PLAY_RADII_C, before, strict=True)]
        after = tuple(float(p[-1] + x[-1]) for p in plays)
        return np.column_stack(plays), after

    return Term(
        name=own,
        sentence="A loop over temperature, the sum of many hysterons.",
        place="input" if place == "input" else "scale",
        coefficients=tuple(
            _coefficient(f"{own}_{k + 1}", f"p{k + 1}", f"{unit}/°C")
            for k in range(len(PLAY_RADII_C))
        ),
        columns=by_run(one_run),
        needs=frozenset(["x_slow_c"]),
    )


def second_lag(follow: Callable[..., FloatArray]) -> InputChange:
    """Return a lag of two poles in a row: `thermal_lag` behind `thermal_lag_second`."""

    def change(record: Record, values: Values, memory: Memory) -> tuple[Record, Memory]:
        changed: dict[str, FloatArray] = {}
        after: dict[str, Memory] = {}
        for signal in ("x_c", "x_slow_c", "rate_c_per_min"):
            if signal not in record.signals:
                continue
            pieces: list[FloatArray] = []
            for index, readings in enumerate(record.run_slices):
                time_s, x = record.time_s[readings], record[signal][readings]
                before = memory[signal] if memory and index == 0 else None
                t0, x0, y0, z0 = before or (float(time_s[0]), *(float(x[0]),) * 3)
                inner = follow(time_s, x, values["thermal_lag"], t0, x0, y0)
                last = follow(time_s, inner, values["thermal_lag_second"], t0, y0, z0)
                after[signal] = tuple(float(v[-1]) for v in (time_s, x, inner, last))
                pieces.append(last)
            changed[signal] = np.concatenate(pieces) if pieces else record[signal]
        return record.with_signals(**changed), after

    return InputChange(
        name="thermal_lag_two_poles",
        sentence="The inside of the accelerometer follows its thermistor through two thermal "
        "resistances in a row.",
        change=change,
        parameters=(
            Parameter(name="thermal_lag", symbol="τ", unit="s", lo=0.1, hi=3600.0, start=60.0),
            Parameter(
                name="thermal_lag_second", symbol="τ2", unit="s", lo=0.1, hi=3600.0, start=20.0
            ),
        ),
        needs=frozenset(["x_c"]),
    )


EVENTS: dict[str, Callable[[], Effect]] = {
    "run_in": run_in,
    "warm_up": warm_up,
    **{f"turn_on_offset_{k}": (lambda k=k: turn_on_offset(k)) for k in range(1, MAX_RUNS)},
    "bias_step": bias_step,
    "bias_drift": bias_drift,
    **{
        "indexer_harmonic" if k == 2 else f"indexer_harmonic_{k}": (lambda k=k: indexer_harmonic(k))
        for k in (2, 3, 4)
    },
    **{f"remount_{k}": (lambda k=k: remount(k)) for k in range(1, MAX_MOUNTINGS)},
    "output_nonlinearity": output_asymmetry,
    "output_nonlinearity_odd": output_bend,
    "bias_hysteresis_start": lambda: loop_start("bias_hysteresis", "input", "µg"),
    "scale_hysteresis_start": lambda: loop_start("scale_hysteresis", "scale", "ppm"),
    "bias_hysteresis_plays": lambda: loop_plays("bias_hysteresis", "input", "µg"),
    "scale_hysteresis_plays": lambda: loop_plays("scale_hysteresis", "scale", "ppm"),
}
