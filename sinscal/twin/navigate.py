"""Outputs of a SINS in its navigation mode on a rig, made from a run of its raw sensors.

The navigator is the real one of `sinscal.flight.strapdown`, on the sensors as they are with their
errors. Every cycle starts anew, as after re-mounting: at the rig's true position, at rest, with the
attitude the SINS has found itself or was given.
"""

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import FloatArray
from sinscal.flight.strapdown import NavState, Track, navigate
from sinscal.recording.run import NavRun, RigRun

EVEN = 1e-3  # how far a step may be from the others of its cycle, relative


def navigate_rig(
    run: RigRun,
    c_nb_start_of_cycle: Sequence[FloatArray],
    *,
    output_step_s: float,
    height_held: bool = True,
) -> NavRun:
    """Navigate a recorded or simulated rig run, cycle by cycle.

    Parameters
    ----------
    run : RigRun
        Raw readings, errors and all.
    c_nb_start_of_cycle : sequence of ndarray, each of shape (3, 3)
        The SINS's own attitude at the start of the first step of each cycle: true, or with the
        errors of an alignment.
    output_step_s : float
        Between outputs; a whole number of the run's steps.
    height_held : bool
        Whether the height stays that of the site.

    Returns
    -------
    NavRun
        The first row of a cycle is its start, before the first step.

    Raises
    ------
    ValueError
        If there is not one attitude a cycle, the steps of a cycle are uneven, the output step is
        not a multiple of them, or a reading is not finite.
    """
    cycles = run.cycles
    if len(c_nb_start_of_cycle) != len(cycles):
        raise ValueError(
            f"{len(c_nb_start_of_cycle)} starting attitudes for {len(cycles)} cycles, expected one "
            "for each"
        )
    tracks: list[Track] = []
    rows: list[FloatArray] = []
    for rows_of_cycle, c_nb in zip(cycles, c_nb_start_of_cycle, strict=True):
        step_s = run.step_s[rows_of_cycle]
        every = _steps_an_output(step_s, output_step_s)
        start = NavState(
            lat_rad=run.facts.site.lat_rad,
            height_m=run.facts.site.height_m,
            velocity=np.zeros(3),
            c_nb=c_nb,
        )
        gyro, accel = run.gyro[rows_of_cycle], run.accel[rows_of_cycle]
        tracks.append(navigate(step_s, gyro, accel, start, every=every, height_held=height_held))
        rows.append(rows_of_cycle.start + every * np.arange(len(tracks[-1])) - 1.0)
    return _joined(run, tracks, rows)


def _steps_an_output(step_s: FloatArray, output_step_s: float) -> int:
    step = float(np.median(step_s))
    if np.abs(step_s / step - 1.0).max() > EVEN:
        raise ValueError("the steps of a cycle are uneven: fill the gaps before navigating it")
    every = round(output_step_s / step)
    if every < 1 or abs(every * step / output_step_s - 1.0) > EVEN:
        raise ValueError(
            f"an output every {output_step_s:g} s is not a whole number of steps of {step:g} s"
        )
    return every


def _joined(run: RigRun, tracks: Sequence[Track], rows: Sequence[FloatArray]) -> NavRun:
    """Put cycles together; row −1 of a cycle is its start, a step before its first row."""
    cycles = run.cycles
    starts = [run.time_s[c.start] - run.step_s[c.start] for c in cycles]
    # at the start of a cycle the temperature is that of its first row
    source = np.concatenate(
        [np.maximum(r, c.start) for r, c in zip(rows, cycles, strict=True)]
    ).astype(np.intp)
    return NavRun(
        time_s=np.concatenate([t0 + t.time_s for t0, t in zip(starts, tracks, strict=True)]),
        cycle=run.cycle[source],
        lat_rad=np.concatenate([t.lat_rad for t in tracks]),
        lon_rad=np.concatenate([t.lon_rad for t in tracks]),
        height_m=np.concatenate([t.height_m for t in tracks]),
        velocity=np.concatenate([t.velocity for t in tracks]),
        c_nb=np.concatenate([t.c_nb for t in tracks]),
        temp_c=None if run.temp_c is None else run.temp_c[source],
        facts=run.facts,
        source=run.source,
        warnings=run.warnings,
    )
