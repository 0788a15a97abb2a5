"""What a test cannot show by its design is told with the coefficient that would hold it."""

from dataclasses import replace

import numpy as np
import pytest

from accelbench.commands.fit.doubts import not_shown_lines
from accelbench.commands.fit.text import fit_document
from tests.strangers.chamber.judge import Verdict, write
from tests.strangers.chamber.physics import Faults
from tests.strangers.chamber.setups import draw
from thermo.compensation.model_file import make_model_file
from thermo.fitting.fit import AccelerometerFit, fit_runs
from thermo.recording.channel import direction_of
from thermo.recording.files import read_runs
from thermo.uncertainty.not_shown import not_shown_sentence

SOUND = draw(3, 30)  # nothing is wrong with it


@pytest.fixture
def fitted(tmp_path):
    """Return a fit of the sound set-up with some of it changed."""

    def fit(**changes) -> AccelerometerFit:
        faults = Faults(SOUND.faults | changes.pop("faults", {}))
        how = replace(
            SOUND, faults=faults, programme="loop", runs=2, rows=160, t_ref_c=25.0, hours=5.0,
            **{"range_c": (0.0, 60.0), **changes},
        )  # fmt: skip
        write(how.record(), tmp_path / "runs.csv", how, how.gravity)
        (one,) = fit_runs(read_runs([tmp_path / "runs.csv"]))
        return one

    return fit


def hidden(one: AccelerometerFit) -> dict[str, tuple[str, ...]]:
    return {n.name: n.stands_in for n in one.doubts.not_shown}


@pytest.mark.parametrize(
    ("head", "dwell", "expected"),
    [
        ("four", 3, {"gain_asymmetry": ("k2",)}),
        ("four", 1, {"gain_asymmetry": ("k2",), "settling": ("k0",)}),
        ("up down", 3, {"gain_asymmetry": ("k0",), "k2_t1": ("k0_t1",)}),
        ("up", 3, {"gain_asymmetry": ("k0",), "k2_t1": ("k0_t1",), "scale_hysteresis": ()}),
        ("none", 3, {}),
    ],
)
def test_effects_that_hide_follow_from_positions_and_readings_a_visit(
    fitted, head: str, dwell: int, expected
) -> None:
    found = hidden(fitted(head=head, dwell=dwell))
    expected = {n: by for n, by in expected.items() if by}
    assert found == expected


def test_a_loop_wider_than_the_range_is_a_slope(fitted) -> None:
    found = hidden(fitted(head="eight", dwell=3, range_c=(23.0, 27.0)))
    assert "k0_t1" in found["bias_hysteresis"]
    assert "k1_t1" in found["wide_scale_hysteresis"]


def test_an_effect_that_the_readings_show_is_told_by_the_residual_instead(fitted) -> None:
    one = fitted(head="eight", dwell=3, faults={"settle_ug": 400.0, "settle_s": 30.0})
    assert "settling" in {f.name for f in one.doubts.left_out}
    assert "settling" not in hidden(one)


def test_the_line_stands_once_for_accelerometers_alike_and_in_the_document(fitted) -> None:
    one = fitted(head="four", dwell=1)
    (line,) = not_shown_lines([one, one])
    assert line == not_shown_sentence(one.doubts.not_shown)
    assert "gains that differ between + and − (in k2)" in line
    assert "settling after each move (in k0)" in line
    (told,) = fit_document([one], make_model_file([one]))["accelerometers"]
    assert [n["name"] for n in told["not_shown"]] == ["gain_asymmetry", "settling"]
    assert told["not_shown"][1]["stands_in"] == ["k0"]


def test_noise_within_two_long_soaks_is_no_direction() -> None:
    noise = 3e-4 * np.random.default_rng(1).standard_normal(400)
    rate = noise.copy()
    rate[200:212] += 0.8 * np.exp(-np.arange(12) / 3.0)  # 3 % of the readings move
    moving = direction_of(rate)
    assert set(moving[200:205].tolist()) == {1}
    assert np.count_nonzero(moving < 0) == 0


def test_what_cannot_be_shown_points_at_a_fault_only_where_it_names_it() -> None:
    text = "this test hardly shows …: gains that differ between + and − (in k2)"
    asked = {"fit_code": 0, "z": {"k2": 9.0}, "text": text}
    assert not Verdict(**asked, kinds=frozenset({"asymmetry"})).silent
    assert Verdict(**asked, kinds=frozenset({"lag"})).silent
    assert Verdict(**asked).silent
