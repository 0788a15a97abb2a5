"""Check of the rig's angle against the gyros."""

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.recording.bins import Bins
from sinscal.recording.run import AXES, RigRun

WRONG, ODD = 0.2, 0.02  # of the ratio of angle to gyro: beyond a rig; beyond a good gyro
STUCK_SHARE = 0.01  # of the turning spans


def check_rig_angle(run: RigRun, bins: Bins, warnings: list[str]) -> None:
    """Compare the rig's angle with the gyro that turns most in each cycle.

    Raises
    ------
    InputError
        If the angle is in degrees, reversed, or stands still while the gyros turn.
    """
    if run.rig_angle_rad is None:
        return
    for k in range(len(run.cycles)):
        mine = bins.cycle == k
        if mine.sum() < 5 or np.isnan(bins.turned[mine]).any():
            continue
        axis = int(np.argmax(np.mean(bins.gyro[mine] ** 2, axis=0)))
        rate: FloatArray = bins.gyro[mine, axis]
        fast = np.abs(rate) > max(0.5 * float(np.max(np.abs(rate))), np.deg2rad(0.2))
        if fast.sum() < 5:
            continue
        # single spans are off where the angle turns over; their median is not
        each = bins.turned[mine][fast] / rate[fast]
        _judge(run, k, AXES[axis], float(np.median(each)))
        still = float(np.mean(np.abs(each) < 1e-3))
        if still > STUCK_SHARE:
            warnings.append(
                f"rig_angle_stuck: the angle stands still in {still:.1%} of cycle {k}'s turning"
            )
        if abs(abs(float(np.median(each))) - 1.0) > ODD:
            warnings.append(
                f"rig_angle_off: in cycle {k} the angle turns {float(np.median(each)):.4f} times "
                f"as fast as gyro {AXES[axis]}"
            )


def _judge(run: RigRun, cycle: int, axis: str, ratio: float) -> None:
    named = run.facts.axis_of_cycle is not None
    said = f"it turns {ratio:.4g} times as fast as gyro {axis}"
    if abs(ratio) < 1e-3:
        why = "stands still while the gyros turn"
    elif abs(abs(ratio) - 180.0 / np.pi) < WRONG * 180.0 / np.pi:
        why = f"is in degrees, expected rad: {said}"
    elif abs(abs(ratio) - 1.0) > WRONG:
        why = f"does not fit the gyros: {said}"
    elif ratio < 0 and named:
        why = f"is reversed: {said}, the axis that axis_of_cycle names"
    else:
        return
    raise InputError(run.source, f"cycle {cycle}: rig_angle_rad", why)
