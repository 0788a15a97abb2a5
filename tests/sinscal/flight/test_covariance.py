"""Flights and what calibrations are worth on them: closed forms, and the full navigator."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from sinscal.article.flight_search import find_trajectories
from sinscal.article.published import ACCEL_NOISE, GYRO_NOISE, published_calibrations
from sinscal.flight.covariance import NOISE, FlightNoise, alignment_map, assess, flight_sensitivity
from sinscal.flight.monte_carlo import agreement, align, fly_runs
from sinscal.flight.navigation_errors import DLAT, DLON
from sinscal.flight.strapdown import NavState, navigate
from sinscal.flight.trajectory import FlightPlan, fly
from sinscal.frames.attitude import rotvec_of
from sinscal.frames.earth import A_M, DEG_PER_H, earth_rate_enu
from sinscal.model.residual_errors import Calibration, at_rest, error_columns, sensor_errors

NOISY = FlightNoise(gyro=GYRO_NOISE, accel=ACCEL_NOISE, alignment_s=600.0)
SNAKE = FlightPlan(
    speed_m_s=200.0, heading_rad=np.pi / 2, amplitude_m=3300.0, period_s=300.0, duration_s=3600.0
)


@pytest.mark.parametrize(
    "plan",
    [
        FlightPlan(heading_rad=0.7),
        FlightPlan(heading_rad=-2.0, amplitude_m=3000.0, period_s=120.0, height_m=9e3),
        FlightPlan(heading_rad=1.0, amplitude_m=2000.0, period_s=120.0, banked=False, takeoff_s=0),
    ],
    ids=["straight", "banked snake", "flat snake"],
)
def test_the_navigator_flies_the_plan_on_its_perfect_sensors(plan: FlightPlan) -> None:
    """Two derivations meet: the flight's sensors by differentiation, the navigator's way back."""
    errors = []
    for step_s in (0.1, 0.05):
        flight = fly(plan, step_s)
        start = NavState(
            lat_rad=plan.latitude_rad,
            height_m=plan.height_m,
            velocity=flight.velocity[0],
            c_nb=flight.c_nb[0],
        )
        steps = np.full(len(flight.mean_gyro), step_s)
        track = navigate(steps, flight.mean_gyro, flight.mean_accel, start, every=len(steps))
        to_m = np.array([1.0, np.cos(flight.lat_rad[-1])]) * A_M
        end = [track.lat_rad[-1] - flight.lat_rad[-1], track.lon_rad[-1] - flight.lon_rad[-1]]
        errors.append(float(np.linalg.norm(to_m * end)))
    # 1 m in 900 km is a thousandth of the errors that are studied; it is the step's, and falls
    assert errors[0] < 1.0
    assert errors[1] < 0.5 * errors[0]


@settings(max_examples=20, deadline=None)
@given(st.floats(60.0, 300.0), st.floats(0.05, 1.0), st.floats(100.0, 1000.0))
def test_the_snake_is_as_wide_as_it_is_given(speed: float, share: float, period: float) -> None:
    amplitude = share * 0.15 * speed * period
    plan = FlightPlan(
        speed_m_s=speed,
        amplitude_m=amplitude,
        period_s=period,
        duration_s=4 * period,
        takeoff_s=0.0,
        banked=False,
    )
    t = np.linspace(2 * period, 3 * period, 4001)
    speed_east = speed * np.sin(plan.swing_rad * np.sin(2 * np.pi * t / period))
    way = np.cumsum(speed_east) * (t[1] - t[0])
    assert np.ptp(way) == pytest.approx(2 * amplitude, rel=1e-5)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"amplitude_m": 30000.0}, "cannot be flown"),
        ({"amplitude_m": 2000.0, "period_s": 40.0}, "cannot be flown"),
        ({"amplitude_m": 1900.0, "period_s": 60.0}, "bank"),
        ({"speed_m_s": 0.0}, "speed_m_s"),
        ({"latitude_rad": 1.55}, "latitude"),
    ],
)
def test_what_no_aircraft_flies_is_refused(change: dict[str, float], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        replace(SNAKE, **change)


def test_the_alignment_s_errors_are_those_of_the_nonlinear_one() -> None:
    coarse, _ = published_calibrations()
    plan = replace(SNAKE, heading_rad=0.6)
    rng = np.random.default_rng(5)
    values = coarse.root @ rng.standard_normal(len(coarse.names))
    c_nb = plan.start_attitude
    rate = c_nb.T @ earth_rate_enu(plan.latitude_rad)
    force = c_nb.T @ np.array([0.0, 0.0, plan.gravity_m_s2])
    wrong = sensor_errors(
        dict(zip(coarse.names, values.tolist(), strict=True)), at_rest(rate, force)
    )[0]
    found = align(rate + wrong[:3], force + wrong[3:])
    phi = rotvec_of(c_nb @ found.T)
    linear = (alignment_map(plan, partial(error_columns, coarse.names)) @ values)[:3]
    # second order: a drift of 0.01 °/h, three sigmas of it, is 4e-3 of the earth's horizontal rate
    assert_allclose(phi, linear, atol=4e-3 * np.abs(linear).max())


def test_at_rest_the_gyrocompass_hides_the_drift_that_made_its_error() -> None:
    """A system that does not move after its alignment: the azimuth error cancels the east drift."""
    plan = FlightPlan(speed_m_s=1e-3, duration_s=1800.0, takeoff_s=0.0)
    names = ("gyro_bias_x", "gyro_bias_y")  # at heading 0 x is east, y north
    end = flight_sensitivity(plan, names, every_s=1800.0).psi[-1] * DEG_PER_H
    # a north drift of 1 °/h carries east by R·(t − sin(νt)/ν) = 20 km in half an hour
    east_m = A_M * np.cos(plan.latitude_rad) * end[DLON, 1]
    nu, t = 1.24e-3, 1800.0
    assert abs(east_m) == pytest.approx(6.37e6 * DEG_PER_H * (t - np.sin(nu * t) / nu), rel=0.02)
    # an east drift would carry north as far; the azimuth that it turned takes all but Ω t of it
    north_m = A_M * end[DLAT, 0]
    assert abs(north_m) < 0.1 * abs(east_m)


def test_misalignments_are_rectified_by_banked_turns_alone() -> None:
    coarse, _ = published_calibrations()
    found = {
        banked: assess(
            flight_sensitivity(
                replace(SNAKE, amplitude_m=1000.0, period_s=120.0, banked=banked), coarse.names
            ),
            coarse,
        )
        for banked in (True, False)
    }
    share = {k: v.share["gyro_misalignment"][-1] for k, v in found.items()}
    assert share[True] > 0.3
    assert share[False] < 0.02


def test_shares_add_up_even_of_correlated_parameters() -> None:
    coarse, _ = published_calibrations()
    rng = np.random.default_rng(1)
    mix = np.linalg.qr(rng.standard_normal((len(coarse.names),) * 2))[0]
    root = coarse.root @ mix * rng.uniform(0.1, 2.0, len(coarse.names))
    correlated = Calibration(names=coarse.names, cov=root @ root.T)
    found = assess(flight_sensitivity(SNAKE, coarse.names, noise=NOISY), correlated)
    assert_allclose(sum(found.share.values())[1:], 1.0, rtol=1e-12)
    assert found.share[NOISE][-1] > 0.0
    lat, lon = found.sigma[-1, [DLAT, DLON]]
    end = flight_sensitivity(SNAKE, coarse.names).lat_rad[-1]
    assert found.rho_end_m == pytest.approx(A_M * np.hypot(lat, np.cos(end) * lon))


def test_the_published_figures_come_out_on_the_stated_snake() -> None:
    """With the article's noise in flight and in a 10-minute alignment; without it they do not."""
    coarse, precise = published_calibrations()
    rho = {
        noisy: [
            assess(flight_sensitivity(SNAKE, c.names, noise=NOISY if noisy else None), c).rho_end_m
            for c in (coarse, precise)
        ]
        for noisy in (True, False)
    }
    assert rho[True] == pytest.approx([1900.0, 1100.0], rel=0.02)
    assert rho[False][0] / rho[False][1] > 2.0  # biases differ 3.3 times, misalignments twice


@pytest.mark.parametrize("which", [0, 1], ids=["coarse", "precise"])
def test_the_full_navigator_agrees_with_the_covariance(which: int) -> None:
    calibration = published_calibrations()[which]
    plan = replace(SNAKE, amplitude_m=1000.0, period_s=120.0)
    predicted = assess(flight_sensitivity(plan, calibration.names, noise=NOISY), calibration)
    flown = fly_runs(plan, calibration, 40, noise=NOISY, seed=which)
    held = agreement(flown, predicted)
    assert held.agrees, held
    # and it can disagree: sigmas a third too small are found out by 40 runs
    small = replace(predicted, cov=predicted.cov / 1.5**2, rho_m=predicted.rho_m / 1.5)
    assert not agreement(flown, small).agrees


def test_a_search_finds_the_snake_that_its_targets_were_made_with() -> None:
    coarse, precise = published_calibrations()
    base = replace(SNAKE, duration_s=1200.0, amplitude_m=0.0)
    wanted = replace(base, amplitude_m=900.0, period_s=120.0)
    found = flight_sensitivity(wanted, coarse.names, noise=NOISY, every_s=1200.0)
    targets = (assess(found, coarse).rho_end_m, assess(found, precise).rho_end_m)
    search = find_trajectories(
        coarse,
        precise,
        base=base,
        noise=NOISY,
        speeds_m_s=(150.0, 250.0),
        swings_rad=(0.1, 0.3),
        periods_s=(120.0,),
        targets=targets,
    )
    assert search.family, search.best
    assert search.best.plan.speed_m_s == pytest.approx(wanted.speed_m_s, rel=0.1)


@pytest.mark.parametrize(
    ("names", "cov", "complaint"),
    [
        (("gyro_bias_x", "gyro_bias_w"), np.eye(2), "gyro_bias_w"),
        (("gyro_bias_x", "gyro_bias_x"), np.eye(2), "twice"),
        (("gyro_bias_x", "gyro_bias_y"), np.eye(3), "shape"),
        (("gyro_bias_x", "gyro_bias_y"), [[1.0, 2.0], [2.0, 1.0]], "negative variance"),
        (("gyro_bias_x", "gyro_bias_y"), [[1.0, 0.5], [0.0, 1.0]], "symmetric"),
        (("gyro_bias_x",), [[np.nan]], "finite"),
    ],
)
def test_what_is_no_covariance_is_refused(names, cov, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Calibration(names=names, cov=np.array(cov))


def test_the_rig_s_own_parameters_do_not_fly() -> None:
    names = ("rig_mount_x", "gyro_bias_x", "accel_temperature_bias_x", "accel_scale_z")
    calibration = Calibration.of_sensors(names, np.diag([1.0, 2.0, 3.0, 4.0]))
    assert calibration.names == ("gyro_bias_x", "accel_scale_z")
    assert_allclose(np.diag(calibration.cov), [2.0, 4.0])


def test_a_jump_is_part_of_the_bias_that_flies() -> None:
    names = ("gyro_bias_x", "gyro_bias_step_x", "accel_scale_z")
    cov = np.array([[4.0, -1.5, 0.2], [-1.5, 2.0, 0.1], [0.2, 0.1, 1.0]])
    calibration = Calibration.of_sensors(names, cov)
    assert calibration.names == ("gyro_bias_x", "accel_scale_z")
    # of bias + step: 4 + 2 − 2·1.5, and their covariances with the scale error
    assert_allclose(calibration.cov, [[3.0, 0.3], [0.3, 1.0]])


def test_half_of_a_drift_about_its_mean_is_part_of_the_bias_that_flies() -> None:
    names = ("gyro_bias_x", "gyro_bias_drift_x")
    calibration = Calibration.of_sensors(names, np.array([[4.0, 1.0], [1.0, 2.0]]))
    assert calibration.names == ("gyro_bias_x",)
    # of bias + drift / 2: 4 + 2 / 4 + 2·1 / 2
    assert_allclose(calibration.cov, [[5.5]])
