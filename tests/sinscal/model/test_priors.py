"""What is expected of every error beforehand, and that nothing is left without."""

import subprocess
import sys

import pytest

from sinscal.model.effects import EFFECTS
from sinscal.model.priors import GROUP_SIGMAS, MOUNT_SIGMA_RAD, prior_sigma

WITH_A_NEW_GROUP = """
import sinscal.model.terms as terms
terms.GROUPS["gyro_vibration"] = terms.GROUPS["gyro_bias"]
import sinscal.model.effects, sinscal.sensitivity.views
"""


def test_an_effect_without_a_prior_is_an_error_at_import() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITH_A_NEW_GROUP], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "groups without a prior: gyro_vibration" in done.stderr


def test_every_effect_of_the_library_is_expected_to_have_some_size() -> None:
    for effect in EFFECTS:
        for group in effect.groups:
            assert prior_sigma(group) > 0.0


def test_a_name_of_no_group_has_no_prior_instead_of_none_at_all() -> None:
    with pytest.raises(KeyError, match="gyro_wobble_x belongs to no group"):
        prior_sigma("gyro_wobble_x")


def test_a_sigma_is_the_own_one_before_that_of_the_group() -> None:
    assert prior_sigma("lever_arm_x_y") == GROUP_SIGMAS["lever_arm"]
    given = {"lever_arm": 0.02, "lever_arm_x_y": 0.01}
    assert prior_sigma("lever_arm_x_x", given) == 0.02
    assert prior_sigma("lever_arm_x_y", given) == 0.01
    assert prior_sigma("rig_mount_z") == MOUNT_SIGMA_RAD
