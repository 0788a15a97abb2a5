"""The clock that a test lives in."""

from drivers.clock import Clock, ScaledClock, SteppedClock
from errormodel.errors import InputError
from thermo.station.job import Job


def clock_of(job: Job, speed: float | None = None) -> Clock:
    """Return the clock of a job's station.

    Parameters
    ----------
    job : Job
    speed : float, optional
        Multiple of real time, of emulated instruments; if not given, that of the station file, or
        as fast as can be where they are emulated in the test's own process.

    Raises
    ------
    InputError
        If the station is real and a speed is given.
    """
    if job.emulated:
        return SteppedClock() if speed is None else ScaledClock(speed)
    emulation = job.station.emulation
    if speed is not None and emulation is None:
        raise InputError(
            "--speed", "", "is for emulated instruments; the station file has no [emulation]"
        )
    return ScaledClock(speed or (emulation.speed if emulation else 1.0))
