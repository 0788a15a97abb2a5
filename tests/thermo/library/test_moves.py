"""What follows the head's last turn: closed forms, and reading by reading as over a whole run."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from errormodel.record import Record
from errormodel.terms import Term
from thermo.library import term
from thermo.library.moves import last_changes

TIME_S = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 50.0])
HEAD = np.array([0.0, 0.0, 90.0, 90.0, 45.0, 45.0])


def record(rows: slice = slice(None)) -> Record:
    force = np.sin(np.deg2rad(HEAD))
    return Record(
        time_s=TIME_S[rows],
        signals={"head_deg": HEAD[rows], "a_i_g": force[rows], "a_p_g": 0.0 * force[rows]},
    )


def columns(name: str, values: dict[str, float], memory: object = None) -> np.ndarray:
    one = term(name)
    assert isinstance(one, Term)
    return one.columns(record(), values, memory)[0]


def test_the_time_since_a_turn_and_its_size():
    since_s, size, _ = last_changes(TIME_S, HEAD, 0.005, None)
    assert_allclose(since_s, [np.inf, np.inf, 0.0, 10.0, 0.0, 10.0])
    assert_allclose(size, [0.0, 0.0, 90.0, 90.0, -45.0, -45.0])


def test_a_bias_dies_away_after_each_turn_and_is_not_there_before_the_first():
    made = columns("settling_after_move", {"settling_tau_s": 20.0})[:, 0]
    assert_allclose(made, [0.0, 0.0, 1.0, np.exp(-0.5), 1.0, np.exp(-0.5)])


def test_friction_keeps_the_sign_of_the_turn_and_stiction_that_of_the_force():
    assert_allclose(columns("move_friction", {})[:, 0], [0, 0, 1, 1, -1, -1])
    assert_allclose(columns("stiction", {})[:, 0], [0, 0, 1, 1, -1, -1])


@pytest.mark.parametrize(
    "name", ["settling_after_move", "settling_by_direction", "move_friction", "stiction"]
)
def test_reading_by_reading_is_as_the_whole_run(name: str):
    one, values, memory = term(name), {"settling_tau_s": 20.0}, None
    assert isinstance(one, Term)
    pieces = []
    for k in range(TIME_S.size):
        made, memory = one.columns(record(slice(k, k + 1)), values, memory)
        pieces.append(made)
    assert_allclose(np.concatenate(pieces), columns(name, values))
