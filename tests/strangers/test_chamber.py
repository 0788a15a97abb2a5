"""Nothing that a stranger's chamber tests show may be wrong without a word."""

from pathlib import Path

import numpy as np
import pytest

from tests.strangers.chamber.judge import CRASH, Verdict, judge
from tests.strangers.chamber.setups import draw

SEED = 3


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(24, id="as it came, 24"),
        pytest.param(35, id="as it came, 35"),
        pytest.param(47, id="as it came, 47"),
        pytest.param(27, id="clipped, 19 visits of a position in a run"),
        pytest.param(56, id="the gains of the two signs differ"),
        pytest.param(150, id="sound, with an order that the choice leaves out"),
    ],
)
def test_a_figure_that_is_wrong_beyond_chance_is_told_of(number: int, tmp_path: Path) -> None:
    found = judge(draw(SEED, number), tmp_path)
    assert found.fit_code in (0, 1, 2)
    assert not found.silent, (found.worst, found.text)


def test_a_sound_set_up_gets_its_coefficients_back_within_five_sigma(tmp_path: Path) -> None:
    found = judge(draw(SEED, 30), tmp_path)
    assert found.fit_code == found.apply_code == 0
    assert len(found.z) > 10
    assert abs(found.worst[1]) < 5.0, found.worst


def test_a_figure_wrong_by_more_than_five_sigma_without_a_word_counts_as_silent() -> None:
    assert Verdict(0, z={"k0": -5.1}, text="valid from −40 to 70 °C").silent
    assert not Verdict(0, z={"k0": -5.1}, text="the residual still follows the rate").silent
    assert not Verdict(1, z={"k0": -5.1}).silent
    assert not Verdict(0, z={"k0": 4.9}).silent
    assert Verdict(0, apply_code=CRASH).silent


def test_the_physics_is_the_equation_where_nothing_is_wrong() -> None:
    how = draw(SEED, 30)
    assert how.kinds == ["sound"]
    sensor = how.sensor
    up = np.array([[1.0, 0.0, 0.0]])
    at_ref = sensor.output(np.array([how.t_ref_c]), up, np.zeros(1), np.zeros(1))[0]
    true = sensor.coefficients(how.t_ref_c)
    assert at_ref / true["k1"] - 1.0 == pytest.approx(
        1e-6 * (true["k0"] + true["k2"] + true["k3"]), abs=1e-12
    )
