"""Several recorded rig runs of one SINS as one run: their cycles follow one another."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.errors import InputError
from sinscal.recording.run import RigRun


def join_rig_runs(runs: Sequence[RigRun]) -> RigRun:
    """Put runs together.

    Raises
    ------
    InputError
        If the runs are not of one site and rig, or some lack what others have.
    """
    first = runs[0]
    if len(runs) == 1:
        return first
    for other in runs[1:]:
        _check_alike(first, other)
    lengths = [len(r.cycles) for r in runs]
    shift = np.cumsum([0, *lengths[:-1]])
    axes = [r.facts.axis_of_cycle or () for r in runs]
    joined = tuple(a for part in axes for a in part)
    facts = replace(first.facts, axis_of_cycle=joined or None)

    def together(name: str):
        return np.concatenate([getattr(r, name) for r in runs])

    return RigRun(
        time_s=together("time_s"),
        step_s=together("step_s"),
        cycle=np.concatenate([r.cycle + k for r, k in zip(runs, shift, strict=True)]),
        gyro=together("gyro"),
        accel=together("accel"),
        temp_c=None if first.temp_c is None else together("temp_c"),
        rig_angle_rad=None if first.rig_angle_rad is None else together("rig_angle_rad"),
        flag=together("flag"),
        facts=facts,
        source=f"{first.source} and {len(runs) - 1} more",
        warnings=tuple(dict.fromkeys(w for r in runs for w in r.warnings)),
    )


def _check_alike(first: RigRun, other: RigRun) -> None:
    same = replace(other.facts, axis_of_cycle=first.facts.axis_of_cycle) == first.facts
    if not same:
        raise InputError(other.source, "", f"its sidecar differs from that of {first.source}")
    for name in ("temp_c", "rig_angle_rad"):
        if (getattr(first, name) is None) != (getattr(other, name) is None):
            raise InputError(other.source, name, f"expected as in {first.source}: in all or none")
    if (first.facts.axis_of_cycle is None) != (other.facts.axis_of_cycle is None):
        raise InputError(other.source, "axis_of_cycle", "expected in all sidecars or none")
