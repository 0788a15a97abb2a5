"""Quantities of a reading: closed forms, and reading by reading as over a whole run."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from errormodel.record import Record
from thermo.library.quantities import (
    LAST_MOVE,
    POSITION_BEFORE,
    QUANTITIES,
    SIDE,
    SINCE_MOVE,
    SINCE_RAMP_CHANGE,
    TURNED_AT,
)

# up by 10 °C, down by 10 °C, in steps of 1 °C and 60 s; the head turns every five readings
X = np.concatenate([np.arange(0.0, 11.0), np.arange(9.0, -1.0, -1.0)])
TIME_S = 60.0 * np.arange(X.size)
HEAD = 90.0 * (np.arange(X.size) // 5)
SIGNALS = {
    "x_slow_c": X,
    "rate_c_per_min": np.gradient(X),
    "head_deg": HEAD,
    "elapsed_h": 30.0 + TIME_S / 3600.0,
    "chamber_less_case_c": 0.1 * X,
}


def record(rows: slice = slice(None)) -> Record:
    return Record(time_s=TIME_S[rows], signals={n: v[rows] for n, v in SIGNALS.items()})


def test_a_ramp_has_a_side_a_begin_and_a_temperature_from_which_it_turned():
    side, since_s, from_c = (
        SIDE.of(record()),
        SINCE_RAMP_CHANGE.of(record()),
        TURNED_AT.of(record()),
    )
    up, down = slice(1, 11), slice(11, None)
    assert np.all(side[up] == 1.0)
    assert np.all(side[down] == -1.0)
    assert_allclose(since_s[down], TIME_S[down] - 600.0)
    assert_allclose(from_c[up], 0.0)
    assert_allclose(from_c[down], 10.0)


def test_less_than_a_thermistors_noise_does_not_turn_a_ramp():
    noisy = record().with_signals(x_slow_c=X + 0.1 * (-1.0) ** np.arange(X.size))
    assert_allclose(SIDE.of(noisy), SIDE.of(record()))


def test_the_heads_last_turn():
    assert_allclose(SINCE_MOVE.of(record())[:7], [0, 60, 120, 180, 240, 0, 60])
    assert_allclose(LAST_MOVE.of(record())[4:6], [0.0, 90.0])
    assert_allclose(POSITION_BEFORE.of(record())[4:6], [0.0, 0.0])


def test_runs_begin_anew():
    twice = Record(
        time_s=np.tile(TIME_S, 2),
        run=np.repeat([0, 1], TIME_S.size),
        signals={n: np.tile(v, 2) for n, v in SIGNALS.items()},
    )
    for one in QUANTITIES.values():
        assert_allclose(one.of(twice)[TIME_S.size :], one.of(record()))


@pytest.mark.parametrize("name", QUANTITIES)
def test_reading_by_reading_is_as_the_whole_run(name: str):
    memory, pieces = None, []
    for k in range(X.size):
        made, memory = QUANTITIES[name].columns(record(slice(k, k + 1)), {}, memory)
        pieces.append(made[:, 0])
    assert_allclose(np.concatenate(pieces), QUANTITIES[name].of(record()))
