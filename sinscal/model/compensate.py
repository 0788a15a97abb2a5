"""Applying a calibration: the readings that ideal sensors would have given."""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.model.motion import Motion
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import RigRun, rate_derivative


def compensate_run(
    run: RigRun, sensors: SensorModel, values: FloatArray, *, later: bool = False
) -> RigRun:
    """Return a run with its sensors' errors taken out; flags, times and the angle stay.

    Parameters
    ----------
    run : RigRun
    sensors : SensorModel
    values : ndarray, shape (p,)
        In the order of `sensors.names`, SI.
    later : bool
        Whether the run was made after the one calibrated: a jump found in that one is then over,
        and its constant errors stay as they were after it.

    Raises
    ------
    InputError
        If the model needs temperatures that the run does not have.
    """
    if sensors.needs_temperature and run.temp_c is None:
        raise InputError(run.source, "temp_c", "missing; the calibration depends on temperature")
    gyro, accel = np.empty_like(run.gyro), np.empty_like(run.accel)
    for rows, begin_s in zip(run.cycles, run.begin_of_cycle_s, strict=True):
        step_s = run.step_s[rows]
        measured = Motion(
            time_s=run.time_s[rows] - run.time_s[rows][0] + step_s[0],
            step_s=step_s,
            w=run.gyro[rows],
            f=run.accel[rows],
            dw=rate_derivative(run.gyro[rows], step_s),
            temp_c=None if run.temp_c is None else run.temp_c[rows],
            begin_s=np.inf if later else begin_s,
        )
        true = sensors.corrected(measured, values)
        gyro[rows], accel[rows] = true.w, true.f
    return replace(run, gyro=gyro, accel=accel)
