"""The linear error equations against a perturbed nonlinear mechanisation."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sinscal.flight.navigation_errors import hold_height, navigation_dynamics
from sinscal.flight.strapdown import NavState, navigate
from sinscal.frames.attitude import c_nb_from_angles, rotation, rotvec_of

LAT, HEIGHT = np.deg2rad(55.75), 3000.0
VELOCITY = np.array([180.0, -140.0, 6.0])
C_NB = c_nb_from_angles(*np.deg2rad([12.0, -4.0, 128.0]))
F_B = C_NB.T @ np.array([1.2, -0.7, 9.6])
W_B = np.array([0.004, -0.01, 0.007])
STEP_S = 0.01
# of each state, so that the square is out of sight and rounding is, too
SMALL = np.array([1e-6] * 3 + [1e-3] * 3 + [1e-7, 1e-7, 1.0])


def end_of(state: np.ndarray, *, held: bool) -> np.ndarray:
    """Navigate one step from a start with errors; return the end."""
    start = NavState(
        lat_rad=LAT + state[6],
        lon_rad=state[7],
        height_m=HEIGHT + state[8],
        velocity=VELOCITY + state[3:6],
        c_nb=rotation(-state[:3]) @ C_NB,
    )
    track = navigate(np.array([STEP_S]), W_B[None], F_B[None], start, height_held=held)
    position = [track.lat_rad[-1], track.lon_rad[-1], track.height_m[-1]]
    return np.concatenate([track.c_nb[-1].ravel(), track.velocity[-1], position])


def error_between(plus: np.ndarray, minus: np.ndarray) -> np.ndarray:
    c_plus, c_minus = plus[:9].reshape(3, 3), minus[:9].reshape(3, 3)
    return np.concatenate([rotvec_of(c_minus @ c_plus.T), plus[9:] - minus[9:]])


@pytest.mark.parametrize("column", range(9))
def test_f_is_the_derivative_of_the_mechanisation(column: int) -> None:
    change = np.zeros(9)
    change[column] = SMALL[column]
    after = error_between(end_of(change, held=False), end_of(-change, held=False)) / 2.0
    derivative = (after - change) / STEP_S / SMALL[column]
    f = navigation_dynamics(LAT, VELOCITY, C_NB @ F_B, HEIGHT)[:, column]
    # a one-step difference differs from F by F²·Δt/2 and by Ḟ·Δt/2 (the body turns by 6e-5 rad)
    square = np.abs(navigation_dynamics(LAT, VELOCITY, C_NB @ F_B, HEIGHT)) @ np.abs(f)
    # and by rounding: of radians in attitude and position, of 228 m/s, of 3 km
    of_value = np.array([2e-16] * 3 + [3e-14] * 3 + [1e-16, 1e-16, 5e-13])
    rounding = 4.0 * of_value / STEP_S / SMALL[column]
    turning = np.zeros(9)
    turning[3:6] = 10.0 * 0.013 * STEP_S if column < 3 else 0.0
    assert (np.abs(derivative - f) < STEP_S * square + rounding + turning).all()


def test_sensor_errors_enter_with_the_signs_that_are_stated() -> None:
    start = NavState(lat_rad=LAT, height_m=HEIGHT, velocity=VELOCITY, c_nb=C_NB)
    dw, df = np.array([2e-6, -3e-6, 1e-6]), np.array([1e-3, 2e-3, -1e-3])
    step = np.array([STEP_S])
    bad = navigate(step, W_B[None] + dw, F_B[None] + df, start, height_held=False)
    good = navigate(step, W_B[None], F_B[None], start, height_held=False)
    phi = rotvec_of(good.c_nb[-1] @ bad.c_nb[-1].T)
    assert_allclose(phi, -C_NB @ dw * STEP_S, atol=1e-3 * 4e-6 * STEP_S)
    gained = bad.velocity[-1] - good.velocity[-1]
    assert_allclose(gained, C_NB @ df * STEP_S, atol=1e-3 * 2e-3 * STEP_S)


def test_a_held_height_has_no_vertical_error() -> None:
    f = navigation_dynamics(LAT, VELOCITY, C_NB @ F_B, HEIGHT)
    free = f.copy()
    hold_height(f)
    assert not f[[5, 8]].any()
    assert not f[:, [5, 8]].any()
    rest = [0, 1, 2, 3, 4, 6, 7]
    assert_allclose(f[np.ix_(rest, rest)], free[np.ix_(rest, rest)])
