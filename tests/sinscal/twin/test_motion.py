"""The rig's true motion: closed forms, at any rate."""

import numpy as np
import pytest

from sinscal.filter.integrate import attitudes
from sinscal.frames.attitude import rotvec_of
from sinscal.frames.earth import ARCMIN
from sinscal.twin.motion import RigFaults, Wobble, rig_motion
from sinscal.twin.programme import Programme, angle_law, there_and_back

FAULTS = RigFaults(
    axis_tilt_rad=(0.01, -0.02),
    azimuth_error_rad=(0.03,),
    mount_rad=(0.01, -0.02, 0.015),
    remount_rad=((0.0, 0.0, 0.0), (1e-3, -2e-3, 5e-4)),
    eccentric_m=(0.1, 0.2, -0.3),
    wobble=(Wobble(order=2, size=3.0 * ARCMIN, phase=0.4),),
)
TURNING = there_and_back((10.0, -25.0), 20.0, acceleration_deg_s2=20.0, azimuth_deg=35.0)


def steady(rate_deg_s: float, duration_s: float = 10.0, axis: str = "x") -> Programme:
    return there_and_back((rate_deg_s,), duration_s, axes=(axis,))


def test_attitude_is_the_same_at_any_rate() -> None:
    slow, fast = rig_motion(TURNING, 50.0, FAULTS), rig_motion(TURNING, 1000.0, FAULTS)
    for a, b in zip(slow.cycles, fast.cycles, strict=True):
        np.testing.assert_allclose(a.c_nb, b.c_nb[19::20], atol=1e-12)  # angles of 3 rad, rounded
        np.testing.assert_allclose(a.angle, b.angle[19::20], atol=1e-12)


def test_coarse_steps_hold_the_means_of_fine_ones() -> None:
    """Also in steps within which the acceleration changes: at 11.75 s, between rows at 50 Hz."""
    slow, fast = rig_motion(TURNING, 50.0, FAULTS), rig_motion(TURNING, 1000.0, FAULTS)
    for a, b in zip(slow.cycles, fast.cycles, strict=True):
        for name in ("w", "f", "dw"):
            mean = getattr(b.motion, name).reshape(-1, 20, 3).mean(axis=1)
            np.testing.assert_allclose(getattr(a.motion, name), mean, atol=2e-11)


@pytest.mark.parametrize("faults", [None, FAULTS])
def test_integrated_rates_reproduce_the_attitude(faults: RigFaults | None) -> None:
    """Poisson's equation on the mean rates at 1 kHz ends where the closed form does.

    Steps of 0.02° leave a coning error of (wobble rate)·(turn)²/12 or so: below 1e-9 rad in 20 s.
    """
    true = rig_motion(TURNING, 1000.0, faults)
    for cycle in true.cycles:
        m = cycle.motion
        w, steps = np.array(m.w), np.array(m.step_s)
        _, end = attitudes(w, steps, np.array(cycle.c_start), true.site.earth_rate)
        # the earth's rotation is in the rates and in the local axes: both integrate it
        apart = rotvec_of(end @ np.swapaxes(cycle.c_nb, 1, 2))
        assert np.max(np.abs(apart)) < 1e-9


def test_force_at_rest_is_gravity_and_points_up() -> None:
    true = rig_motion(steady(0.0), 50.0, FAULTS)
    cycle = true.cycles[0]
    size = np.linalg.norm(cycle.motion.f, axis=1)
    np.testing.assert_allclose(size, true.site.gravity_m_s2, rtol=1e-13)
    up = cycle.c_nb[0] @ cycle.motion.f[0]
    np.testing.assert_allclose(up, [0.0, 0.0, true.site.gravity_m_s2], atol=1e-12)


def test_an_eccentric_mounting_adds_centripetal_and_tangential_force() -> None:
    """About x by ω with the point at (0, r, 0): −ω²r along y, and ω̇r along z; x feels nothing."""
    r = 0.2
    eccentric = RigFaults(eccentric_m=(0.5, r, 0.0))
    speed = np.deg2rad(30.0)
    for programme, w2, dw in (
        (steady(30.0), speed**2, 0.0),
        (steady(60.0).model_copy(update={"acceleration_deg_s2": 10.0}), None, np.deg2rad(10.0)),
    ):
        cycle = rig_motion(programme, 100.0, eccentric).cycles[0]
        added = cycle.motion.f - rig_motion(programme, 100.0).cycles[0].motion.f
        first = slice(0, 500)  # in the second programme the rate still grows
        end = cycle.motion.time_s[first]
        h = 0.01  # mean of (αt)² over a step: α²(t² − th + h²/3)
        square = w2 if w2 is not None else dw**2 * (end**2 - end * h + h**2 / 3.0)
        np.testing.assert_allclose(added[first, 0], 0.0, atol=1e-13)
        np.testing.assert_allclose(added[first, 1], -square * r, atol=1e-13)
        np.testing.assert_allclose(added[first, 2], dw * r, atol=1e-13)


def test_a_tilted_axis_stands_where_it_is_told() -> None:
    tilted = RigFaults(axis_tilt_rad=(0.02,), azimuth_error_rad=(0.1,))
    true = rig_motion(steady(10.0).model_copy(update={"azimuth_deg": 30.0}), 50.0, tilted)
    along = true.cycles[0].c_nb @ np.array([1.0, 0.0, 0.0])
    azimuth = np.deg2rad(30.0) + 0.1
    level = np.cos(0.02) * np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    told = level + np.array([0.0, 0.0, np.sin(0.02)])
    np.testing.assert_allclose(along, np.tile(told, (500, 1)), atol=1e-12)


def test_axes_that_are_not_orthogonal_are_another_mounting_in_their_cycle() -> None:
    bent = RigFaults(remount_rad=((0.0, 0.0, 0.0), (0.0, 0.0, 1e-3)))
    true = rig_motion(there_and_back((10.0,), 10.0, axes=("x", "y")), 50.0, bent)
    straight = rig_motion(there_and_back((10.0,), 10.0, axes=("x", "y")), 50.0)
    np.testing.assert_array_equal(true.cycles[0].c_nb, straight.cycles[0].c_nb)
    apart = rotvec_of(np.swapaxes(straight.cycles[1].c_nb, 1, 2) @ true.cycles[1].c_nb)
    np.testing.assert_allclose(apart, np.tile([0.0, 0.0, 1e-3], (500, 1)), atol=1e-12)


def test_the_axis_of_a_wobbling_platform_runs_round_a_cone() -> None:
    size = 60.0 * ARCMIN
    cone = RigFaults(wobble=(Wobble(order=3, size=size),))
    cycle = rig_motion(steady(10.0, 36.0), 50.0, cone).cycles[0]
    axis = cycle.c_nb @ np.array([1.0, 0.0, 0.0])
    along = rig_motion(steady(10.0, 36.0), 50.0).cycles[0].c_nb[0] @ np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(np.arccos(axis @ along), size, rtol=1e-9)


def test_reversals_take_their_time() -> None:
    law = angle_law(TURNING.cycles[0], 20.0)
    at = np.linspace(0.0, law.duration_s, 20001)
    angle, rate, accel = law.at(at)
    limit = np.deg2rad(20.0)
    assert np.max(np.abs(accel)) == pytest.approx(limit)
    step = law.duration_s / 20000
    assert np.max(np.abs(np.diff(rate))) <= limit * step * (1 + 1e-9)
    summed = np.cumsum(0.5 * (rate[1:] + rate[:-1])) * step
    # trapezoids are exact but in the few steps with a knot inside: each is off by α·dt²/8 at most
    np.testing.assert_allclose(angle[1:] - angle[0], summed, atol=8 * limit * step**2 / 8)


def test_a_segment_too_short_for_its_change_of_rate_is_told() -> None:
    with pytest.raises(ValueError, match="shorter than"):
        rig_motion(there_and_back((90.0, -90.0), 10.0, acceleration_deg_s2=10.0), 50.0)
