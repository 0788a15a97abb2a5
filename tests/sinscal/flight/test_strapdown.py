"""Strapdown navigation against closed forms, and how it converges with the rate."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from sinscal.flight.strapdown import NavState, Track, navigate
from sinscal.frames.attitude import angles_from_c_nb, c_nb_from_angles, rotation, rotvec_of
from sinscal.frames.earth import A_M, RATE_RAD_S, earth_rate_enu, gravity_m_s2, radii_m
from sinscal.frames.quaternions import product, turned, unit_quaternion

LAT = np.deg2rad(55.75)
G = gravity_m_s2(LAT, 0.0)
SCHULER_RAD_S = np.sqrt(G / radii_m(LAT)[0])  # of north-south motion


def at_rest(
    c_nb: np.ndarray,
    hours: float,
    *,
    rate_hz: float = 50.0,
    gyro_error: np.ndarray | float = 0.0,
    accel_error: np.ndarray | float = 0.0,
    height_held: bool = True,
) -> Track:
    """Navigate a body that does not move; the errors are in east-north-up."""
    n = round(3600 * hours * rate_hz)
    gyro = c_nb.T @ (earth_rate_enu(LAT) + gyro_error)
    accel = c_nb.T @ (np.array([0.0, 0.0, G]) + accel_error)
    return navigate(
        np.full(n, 1.0 / rate_hz),
        np.broadcast_to(gyro, (n, 3)),
        np.broadcast_to(accel, (n, 3)),
        NavState(lat_rad=LAT, velocity=np.zeros(3), c_nb=c_nb),
        every=round(rate_hz * 10),
        height_held=height_held,
    )


@pytest.mark.parametrize("height_held", [True, False])
def test_perfect_sensors_at_rest_stay_where_they_are(height_held: bool) -> None:
    c_nb = c_nb_from_angles(*np.deg2rad([10.0, -20.0, 130.0]))
    track = at_rest(c_nb, 1.0, height_held=height_held)
    # a rounding of 2.2e-16 rad in each of 180 000 steps, were they all one way
    rounding = 180_000 * np.finfo(float).eps
    assert np.abs(rotvec_of(track.c_nb @ c_nb.T)).max() < rounding
    assert np.abs(track.lat_rad - LAT).max() * A_M < rounding * A_M  # 0.25 mm
    assert np.abs(track.lon_rad).max() * A_M < rounding * A_M
    # a free height multiplies what it has by cosh(√(2g/R)·t) = 260 in an hour
    assert np.abs(track.height_m).max() < (1e-12 if height_held else 260 * rounding * A_M)


def test_an_accelerometer_bias_gives_a_schuler_oscillation() -> None:
    bias = 1e-3
    track = at_rest(np.eye(3), 1.5, accel_error=np.array([0.0, bias, 0.0]))
    north_m = (track.lat_rad - LAT) * radii_m(LAT)[0]
    expected = bias / SCHULER_RAD_S**2 * (1.0 - np.cos(SCHULER_RAD_S * track.time_s))
    # left out: the coupling to east through the earth's rate, 1 - cos(Ω sin φ t) = 5 % in 1.5 h
    assert_allclose(north_m, expected, atol=0.05 * expected.max())
    early = track.time_s < 900.0  # there it is 1 - cos(0.054) = 0.15 %, of the first integral half
    assert_allclose(north_m[early], expected[early], atol=1.5e-3 * expected[early].max())


def test_a_vertical_gyro_bias_drifts_the_azimuth() -> None:
    drift = np.deg2rad(0.1) / 3600.0
    track = at_rest(np.eye(3), 1.0, gyro_error=np.array([0.0, 0.0, drift]))
    heading = np.unwrap(angles_from_c_nb(track.c_nb)[2])
    # a positive rate about up turns the computed heading to the west; the tilts that the turned
    # earth's rate makes come back into it with Ω² t² = 7 % of an hour, a third of that at the end
    assert_allclose(heading - heading[0], -drift * track.time_s, atol=0.04 * drift * 3600)


def test_a_free_height_runs_away_exponentially() -> None:
    error = 1e-4
    track = at_rest(np.eye(3), 0.25, accel_error=np.array([0.0, 0.0, error]), height_held=False)
    gradient = (gravity_m_s2(LAT, -50.0) - gravity_m_s2(LAT, 50.0)) / 100.0
    k = np.sqrt(gradient)
    expected = error / k**2 * (np.cosh(k * track.time_s) - 1.0)
    # left out: the Eötvös term of the speeds that arise, (2Ω t)²/6 of it in 900 s
    assert_allclose(track.height_m, expected, rtol=3e-3, atol=1e-6)


def coning(rate_hz: float, seconds: float, cone_rad: float, turns_hz: float) -> float:
    """Return the rate at which the attitude of a body that cones is lost, rad/s.

    C(t) = exp(χ u(t) ×), u turning in the x-y plane with rate w: its rate in the body is
    w·(−sin χ sin wt, sin χ cos wt, −(1 − cos χ)), which can be integrated in closed form.
    """
    h, w, n = 1.0 / rate_hz, 2.0 * np.pi * turns_hz, round(seconds * rate_hz)
    t = h * np.arange(n + 1)
    s, c = np.sin(cone_rad), np.cos(cone_rad)
    whole = np.column_stack([s * np.cos(w * t), s * np.sin(w * t), -(1.0 - c) * w * t])
    start = rotation(cone_rad * np.array([1.0, 0.0, 0.0]))
    state = NavState(lat_rad=0.0, velocity=np.zeros(3), c_nb=start)
    track = navigate(np.full(n, h), np.diff(whole, axis=0) / h, np.zeros((n, 3)), state, every=n)
    # after whole turns the body is as it was; the local axes have turned with the earth under it
    earth = rotation(-RATE_RAD_S * seconds * np.array([0.0, 1.0, 0.0]))
    return float(np.linalg.norm(rotvec_of(track.c_nb[-1] @ (earth @ start).T))) / seconds


def test_coning_is_compensated_and_converges_with_the_rate() -> None:
    cone = np.deg2rad(1.0)
    drift = 0.5 * cone**2 * 2 * np.pi  # what the cone looks like at 1 Hz when it is not
    slow, fast = coning(50.0, 20.0, cone, 1.0), coning(100.0, 20.0, cone, 1.0)
    # the next term of the series in the angle per step is (2π/50)²/… of the first: 2e-3 of it
    assert slow < 5e-3 * drift
    assert slow / fast > 7.0  # at least of third order


def sculling(rate_hz: float, seconds: float) -> np.ndarray:
    """Return the velocity error of a body that swings about x while pushed along y in step."""
    w, swing, push, fine = 2 * np.pi, 0.02, 1.0, 64
    h, n = 1.0 / rate_hz, round(seconds * rate_hz)
    t = (np.arange(n * fine) + 0.5) * h / fine
    angle, along, none = swing * np.sin(w * t), push * np.sin(w * t), np.zeros_like(t)
    gyro = np.column_stack([w * swing * np.cos(w * t), none, none])
    accel = np.column_stack([none, along, none])
    mean_gyro, mean_accel = (x.reshape(n, fine, 3).mean(axis=1) for x in (gyro, accel))
    start = NavState(lat_rad=0.0, velocity=np.zeros(3), c_nb=np.eye(3))
    track = navigate(np.full(n, h), mean_gyro, mean_accel, start, height_held=False)
    pushed = np.column_stack([none, along * np.cos(angle), along * np.sin(angle)])
    expected = pushed[fine:].sum(axis=0) * h / fine  # the first step has no slope yet
    expected[2] -= gravity_m_s2(0.0, 0.0) * (seconds - h)
    return track.velocity[-1] - track.velocity[1] - expected


def test_sculling_is_compensated() -> None:
    rectified = 0.5 * 0.02 * 1.0 * 10.0  # m/s in 10 s when it is not
    # the earth's rate does the same at all rates, and goes out with the difference
    slow, fast, finest = (sculling(r, 10.0)[2] for r in (50.0, 100.0, 800.0))
    assert abs(slow - finest) < 2e-3 * rectified
    assert (slow - finest) / (fast - finest) > 7.0  # at least of third order


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_steps_may_be_cut_as_one_likes_while_the_rate_is_constant(rate: list[float]) -> None:
    cuts = np.array([0.004, 0.011, 0.005, 0.02, 0.01])
    start = NavState(lat_rad=LAT, velocity=np.zeros(3), c_nb=np.eye(3))

    def end(step: np.ndarray) -> Track:
        n = step.size
        gyro, accel = np.tile(rate, (n, 1)), np.tile([0.3, -1.0, G], (n, 1))
        return navigate(step, gyro, accel, start, every=n, height_held=False)

    whole, parts = end(np.array([cuts.sum()])), end(cuts)
    # the speed is taken to change evenly over a step, while the push turns with the body: at most
    # |f||ω|h³/12 of way is lost, which turns the local axes by way/R·√(1 + tan²φ)
    way = G * 5.2 * cuts.sum() ** 3 / 12.0
    assert_allclose(whole.c_nb, parts.c_nb, atol=1.8 * way / A_M)
    assert_allclose(whole.velocity, parts.velocity, atol=2.0 * RATE_RAD_S * way)


def test_what_cannot_be_navigated_is_refused() -> None:
    start = NavState(lat_rad=LAT, velocity=np.zeros(3), c_nb=np.eye(3))
    good, nan = np.zeros((2, 3)), np.full((2, 3), np.nan)
    with pytest.raises(ValueError, match="finite"):
        navigate(np.ones(2), nan, good, start)
    with pytest.raises(ValueError, match="positive"):
        navigate(np.array([1.0, 0.0]), good, good, start)
    with pytest.raises(ValueError, match="expected"):
        navigate(np.ones(3), good, good, start)
    with pytest.raises(ValueError, match="not a rotation"):
        NavState(lat_rad=LAT, velocity=np.zeros(3), c_nb=2.0 * np.eye(3))


def test_quaternions_turn_as_their_matrices() -> None:
    a, b, x = (0.3, -1.2, 2.0), (1e-5, 0.0, -2e-5), (0.5, -3.0, 1.0)
    both = product(unit_quaternion(a), unit_quaternion(b))
    expected = rotation(np.array(a)) @ rotation(np.array(b)) @ np.array(x)
    assert_allclose(turned(both, x), expected, atol=4e-15)
