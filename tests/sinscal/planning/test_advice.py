"""What a small change of a programme brings is told before the test."""

import numpy as np

from sinscal.filter.data import RigNoise
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.library import BASIC
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from sinscal.planning.advice import Advice, plan_advice
from sinscal.planning.covariance import rig_covariance
from sinscal.twin.programme import there_and_back

NOISE = RigNoise(gyro=0.1 * DEG_PER_H, accel=1e-3, angle=15 * ARCSEC)


def advised(
    rates: tuple[float, ...], azimuth_deg: float, azimuth: float | None = None, *groups: str
) -> tuple[Advice, ...]:
    programme = there_and_back(rates, 300.0, azimuth_deg=azimuth_deg)
    sensors = sensor_model((*BASIC, *groups))
    prior = make_prior(sensors)
    found = rig_covariance(programme, sensors, prior, NOISE, angle=False, azimuth_sigma_rad=azimuth)
    return plan_advice(
        found, programme, sensors, prior, NOISE, angle=False, azimuth_sigma_rad=azimuth
    )


def test_an_axis_from_east_to_west_needs_the_azimuth() -> None:
    (told,) = advised((10.0, -10.0), 90.0)
    assert "azimuth" in told.change
    assert told.name.startswith("gyro_bias_")
    assert told.factor > 5.0
    assert advised((10.0, -10.0), 90.0, np.deg2rad(1 / 60)) == ()


def test_one_speed_does_not_show_lever_arms_and_two_do() -> None:
    (told,) = advised((10.0, -10.0), 0.0, np.deg2rad(1 / 60), "lever_arm")
    assert "speed" in told.change
    assert told.name.startswith("accel_bias_")
    assert told.factor > 10.0
    assert told.others == ("lever_arm",)
    assert advised((10.0, -10.0, 5.0, -5.0), 0.0, np.deg2rad(1 / 60), "lever_arm") == ()
