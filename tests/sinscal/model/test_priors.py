"""What is expected of every error beforehand, and that nothing is left without."""

from pathlib import Path

import pytest

from sinscal.library import lever, rig_library
from sinscal.library.angle import MOUNT_SIGMA_RAD
from sinscal.model.priors import prior_sigma

PRIOR = "    prior_sigma=0.1,  # assumed: the size of a SINS\n"


@pytest.mark.parametrize(
    ("instead", "complaint"),
    [
        ("", "missing 1 required keyword-only argument: 'prior_sigma'"),
        ("    prior_sigma=0.0,\n", "group without a prior: lever_arm"),
    ],
)
def test_an_effect_without_a_prior_is_an_error_at_import(instead: str, complaint: str) -> None:
    source = Path(lever.__file__).read_text(encoding="utf-8")
    assert source.count(PRIOR) == 1
    with pytest.raises((TypeError, ValueError), match=complaint):
        exec(source.replace(PRIOR, instead), {"__name__": "spoiled"})


def test_every_effect_of_the_library_is_expected_to_have_some_size() -> None:
    known = rig_library()
    assert known.effects
    for effect in known.effects:
        for group in effect.groups:
            assert prior_sigma(known.told[group]) > 0.0


def test_a_name_of_no_group_has_no_prior_instead_of_none_at_all() -> None:
    with pytest.raises(KeyError, match="gyro_wobble_x is not in a group"):
        rig_library().parameter("gyro_wobble_x")


def test_a_sigma_is_the_own_one_before_that_of_the_group() -> None:
    known = rig_library()
    across, along = known.parameter("lever_arm_x_y"), known.parameter("lever_arm_x_x")
    assert prior_sigma(across) == known.groups["lever_arm"].prior_sigma
    given = {"lever_arm": 0.02, "lever_arm_x_y": 0.01}
    assert prior_sigma(along, given) == 0.02
    assert prior_sigma(across, given) == 0.01
    assert prior_sigma(known.parameter("rig_mount_z")) == MOUNT_SIGMA_RAD


def test_a_jump_is_expected_to_be_as_large_as_the_constant_error_that_jumps() -> None:
    known = rig_library()
    jump = known.parameter("accel_bias_step_y")
    assert (jump.group, jump.family, jump.axis) == ("accel_bias_step", "accel_bias", "y")
    assert prior_sigma(jump) == prior_sigma(known.parameter("accel_bias_y"))
    assert prior_sigma(jump, {"accel_bias": 1e-3}) == 1e-3
