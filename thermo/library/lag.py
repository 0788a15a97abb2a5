"""Thermal lags: the inside of the accelerometer follows its thermistor."""

from collections.abc import Callable, Sequence

import numba
import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Effect, InputChange, Memory, Parameter, Values
from thermo.library.effects import Context, Example, Form, ThermalEffect, log_grid

LAGGING = ("x_c", "x_slow_c", "rate_c_per_min")  # signals of the inside temperature


@numba.njit(cache=True)
def _follow(
    time_s: FloatArray, x: FloatArray, tau_s: float, last_t: float, last_x: float, state: float
) -> FloatArray:
    out = np.empty(x.size)
    for k in range(x.size):
        step = time_s[k] - last_t
        if step > 0:
            slope = (x[k] - last_x) / step
            keep = np.exp(-step / tau_s)
            # exact answer of a first-order lag to an input that is straight between readings
            state = x[k] - slope * tau_s + (state - last_x + slope * tau_s) * keep
        last_t, last_x = time_s[k], x[k]
        out[k] = state
    return out


def _lagging(record: Record, memory: Memory, taus_s: Sequence[float]) -> tuple[Record, Memory]:
    """Return the record after first-order lags in series, and the state of each lag."""
    changed: dict[str, FloatArray] = {}
    after: dict[str, Memory] = {}
    for signal in LAGGING:
        if signal not in record.signals:
            continue
        pieces: list[FloatArray] = []
        for index, readings in enumerate(record.run_slices):
            time_s, x = record.time_s[readings], record[signal][readings]
            before = memory[signal] if memory and index == 0 else None
            last_t, *last = before or (float(time_s[0]), *(float(x[0]),) * (len(taus_s) + 1))
            levels = [x]
            for k, tau_s in enumerate(taus_s):
                levels.append(_follow(time_s, levels[-1], tau_s, last_t, last[k], last[k + 1]))
            after[signal] = tuple(float(v[-1]) for v in (time_s, *levels))
            pieces.append(levels[-1])
        changed[signal] = np.concatenate(pieces) if pieces else record[signal]
    return record.with_signals(**changed), after


def thermal_lag() -> InputChange:
    """Return the lag of the accelerometer's inside behind its thermistor."""

    def change(record: Record, values: Values, memory: Memory) -> tuple[Record, Memory]:
        return _lagging(record, memory, [values["thermal_lag"]])

    return InputChange(
        name="thermal_lag",
        sentence="The inside of the accelerometer follows its thermistor with a time constant.",
        change=change,
        parameters=(
            Parameter(name="thermal_lag", symbol="τ", unit="s", lo=0.1, hi=3600.0, start=60.0),
        ),
        needs=frozenset(["x_c"]),
    )


def thermal_lag_two_poles() -> InputChange:
    """Return a lag with two poles in series: `thermal_lag` behind `thermal_lag_second`."""

    def change(record: Record, values: Values, memory: Memory) -> tuple[Record, Memory]:
        return _lagging(record, memory, [values["thermal_lag"], values["thermal_lag_second"]])

    return InputChange(
        name="thermal_lag_two_poles",
        sentence="The inside of the accelerometer follows its thermistor through two thermal "
        "resistances in series.",
        change=change,
        parameters=(
            Parameter(name="thermal_lag", symbol="τ", unit="s", lo=0.1, hi=3600.0, start=60.0),
            Parameter(
                name="thermal_lag_second",
                symbol="τ2",
                unit="s",
                lo=0.1,
                hi=3600.0,
                start=20.0,
                family="thermal_lag",
                label="second",
            ),
        ),
        needs=frozenset(["x_c"]),
    )


def _forms(at: Context) -> Sequence[Form]:
    if {"thermal_lag", "thermal_lag_two_poles"} & at.term_names:
        return []
    longest = float(np.clip(at.run_s / 4.0, 60.0, 3600.0))
    pairs = tuple(
        (float(t), float(t) * share)
        for t in np.geomspace(4.0, longest, 9)
        for share in (0.1, 0.4, 1.0)
    )
    return [
        Form(
            terms=("thermal_lag",),
            parameters=("thermal_lag",),
            grid=log_grid(0.1, longest, 26),
        ),
        Form(
            terms=("thermal_lag_two_poles",),
            parameters=("thermal_lag", "thermal_lag_second"),
            grid=pairs,
        ),
    ]


TERMS: dict[str, Callable[[], Effect]] = {
    "thermal_lag": thermal_lag,
    "thermal_lag_two_poles": thermal_lag_two_poles,
}
EFFECTS = (
    ThermalEffect(
        name="thermal_lag",
        sentence="The inside of the accelerometer follows its thermistor with a time constant of "
        "{size}: while the temperature changes, it differs from the recorded one.",
        forms=_forms,
        experiment="a second ramp rate, and holds of three time constants after each ramp: the "
        "effect of a lag decays in the holds and is proportional to the slope of scale factor "
        "and bias",
        # the thermistor is on the shell; the proof mass follows with one minute
        example=Example(term="thermal_lag", values={"thermal_lag": 60.0}),
    ),
)
