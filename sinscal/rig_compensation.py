"""Applying a calibration: the readings that ideal sensors would have given."""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.run import RigRun
from sinscal.sensors import Motion, SensorModel, rate_derivative


def compensate_run(run: RigRun, sensors: SensorModel, values: FloatArray) -> RigRun:
    """Return a run with its sensors' errors taken out; flags, times and the angle stay.

    Parameters
    ----------
    run : RigRun
    sensors : SensorModel
    values : ndarray, shape (p,)
        In the order of `sensors.names`, SI.

    Raises
    ------
    InputError
        If the model needs temperatures that the run does not have.
    """
    if sensors.needs_temperature and run.temp_c is None:
        raise InputError(run.source, "temp_c", "missing; the calibration depends on temperature")
    gyro, accel = np.empty_like(run.gyro), np.empty_like(run.accel)
    for rows in run.cycles:
        step_s = run.step_s[rows]
        measured = Motion(
            time_s=run.time_s[rows] - run.time_s[rows][0] + step_s[0],
            step_s=step_s,
            w=run.gyro[rows],
            f=run.accel[rows],
            dw=rate_derivative(run.gyro[rows], step_s),
            temp_c=None if run.temp_c is None else run.temp_c[rows],
        )
        true = sensors.corrected(measured, values)
        gyro[rows], accel[rows] = true.w, true.f
    return replace(run, gyro=gyro, accel=accel)
