"""Check of a rig run against physics and its sidecar.

What makes every result wrong is an error that names the likely cause; what may be a poor sensor
as well as a fault is a named warning of the run.
"""

from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.recording.angle_check import check_rig_angle
from sinscal.recording.axis_faults import factor_name, fault_names, force_name, permutation_of
from sinscal.recording.bins import Bins, bins_of
from sinscal.recording.gravity_map import GravityMap, gravity_map
from sinscal.recording.reversed_force import force_points_down
from sinscal.recording.run import AXES, RigRun
from sinscal.recording.shocks import find_shocks

FORCE_WRONG, FORCE_ODD = 0.15, 0.03  # of gravity: beyond any sensor; beyond a good one
MAP_WRONG, MAP_ODD = 0.3, 0.05  # entries of the gravity map, likewise
SIGMAS = 5.0
LONGEST_STEP_S = 5.0  # attitude cannot be carried through longer ones
UNEXPLAINED = 0.3  # of the rms change of gravity between spans
TURNING = np.deg2rad(0.2)  # rad/s: slower is rest
AXIS_SHARE = 0.8  # of a cycle's mean square rate about the axis that the sidecar names


def checked_rig(run: RigRun) -> RigRun:
    """Check a run against physics and flag shocks; return it with flags and warnings added.

    Raises
    ------
    InputError
        If the readings contradict gravity, each other, the rig's angle or the sidecar.
    """
    warnings: list[str] = []
    _check_step(run)
    _check_force(run, warnings)
    run = _flag_shocks(run, warnings)
    found = gravity_map(run)
    bins = bins_of(run, 1.0)
    if found is not None:
        bins = replace(bins, gyro=bins.gyro - found.bias)
    if found is not None:
        _check_map(run, found, warnings)
    if found is None or not any(found.known):
        warnings.append(
            "axes_not_checked: the run turns too little to check the gyros against gravity"
        )
    _check_axes(run, bins)
    check_rig_angle(run, bins, warnings)
    if force_points_down(run, bins):
        warnings.append(
            "reversed_force: the earth's rotation along the measured force has the sign of a "
            "force that points down; all three accelerometers may be reversed"
        )
    return replace(run, warnings=(*run.warnings, *warnings))


def _check_step(run: RigRun) -> None:
    step_s = float(np.median(run.step_s))
    if step_s > LONGEST_STEP_S:
        raise InputError(
            run.source, "time_s", f"steps of {step_s:g} s, expected {LONGEST_STEP_S:g} s at most; "
            "are they in ms?"
        )  # fmt: skip


def _check_force(run: RigRun, warnings: list[str]) -> None:
    gravity = run.facts.site.gravity_m_s2
    force = float(np.median(np.linalg.norm(run.accel, axis=1)))
    ratio = force / gravity
    said = f"the specific force is {force:.4g}, expected gravity, {gravity:.4f} m/s²"
    if abs(ratio - 1.0) > FORCE_WRONG:
        step_s = float(np.median(run.step_s))
        hint = force_name(max(ratio, 1e-300), gravity, step_s)
        raise InputError(run.source, "accel", f"{said}; {hint}")
    if abs(ratio - 1.0) > FORCE_ODD:
        warnings.append(f"force_off: {said}")


def _flag_shocks(run: RigRun, warnings: list[str]) -> RigRun:
    found = find_shocks(run)
    if not found:
        return run
    flag = np.array(run.flag, dtype=np.bool_)
    for one in found:
        flag[one.first : one.last + 1] = True
    for name in ("shock", "saturated"):
        mine = [one for one in found if one.reason.endswith(name)]
        if mine:
            rows = sum(one.last - one.first + 1 for one in mine)
            at = ", ".join(
                f"{run.time_s[one.first]:.6g} s of cycle {int(run.cycle[one.first])}"
                for one in mine[:3]
            )
            more = f" and {len(mine) - 3} more" if len(mine) > 3 else ""
            what = ", ".join(sorted({one.reason for one in mine}))
            warnings.append(f"{name}: {rows} rows flagged ({what}): {at}{more}")
    return replace(run, flag=flag)


def _check_map(run: RigRun, found: GravityMap, warnings: list[str]) -> None:
    known = np.flatnonzero(found.known)
    if found.unexplained > UNEXPLAINED:
        warnings.append(
            f"gravity_unexplained: {found.unexplained:.0%} of the rotation of gravity does not "
            f"appear in the gyro readings with any scale, sign or order"
        )
    if not known.size:
        return
    matrix = found.matrix
    off = np.abs(matrix - np.eye(3))[:, known]
    sure = off > SIGMAS * found.sigma[:, known]
    if not np.any(sure & (off > MAP_ODD)):
        return
    said = _names_of_fault(matrix, found.known, float(np.median(run.step_s)))
    if np.any(sure & (off > MAP_WRONG)):
        raise InputError(
            run.source, "gyro", f"the gyros do not agree with the rotation of gravity: {said}"
        )
    warnings.append(
        f"gravity_map: gravity rotated by the gyros differs from the accelerometers by up to "
        f"{float(off[sure].max()):.0%}: {said}"
    )


def _names_of_fault(matrix: FloatArray, known: tuple[bool, ...], step_s: float) -> str:
    size: FloatArray = np.linalg.norm(matrix, axis=0)[list(known)]  # not zero where it is known
    parts: list[str] = []
    factor = float(np.exp(np.mean(np.log(size))))
    if np.ptp(np.log(size)) > 0.3:
        each = ", ".join(
            f"{AXES[k]} {np.linalg.norm(matrix[:, k]):.3g}" for k in np.flatnonzero(known)
        )
        parts.append(f"readings need the factors {each}")
    elif abs(np.log(factor)) > 0.14:
        parts.append(f"readings need a factor of {factor:.4g}; {factor_name(factor, step_s)}")
    permutation = permutation_of(matrix, known)
    if permutation is None:
        parts.append("the triads are rotated against each other, or one is not a triad")
    else:
        names = fault_names(permutation, known)
        if names != [""]:
            parts.append("swapped_axes: simplest explanation: " + ", or ".join(names[:3]))
    return "; ".join(parts) or "no swap, sign or unit explains it"


def _check_axes(run: RigRun, bins: Bins) -> None:
    """Refuse a sidecar that names another axis than the gyros turn about."""
    axes = run.facts.axis_of_cycle
    if axes is None:
        return
    for k, axis in enumerate(axes):
        mine = bins.cycle == k
        if not mine.any():
            continue
        power: FloatArray = np.mean(bins.gyro[mine] ** 2, axis=0)
        total = float(power.sum())
        if total < TURNING**2:
            continue
        share = float(power[AXES.index(axis)]) / total
        if share < AXIS_SHARE:
            turns = AXES[int(np.argmax(power))]
            raise InputError(
                run.source,
                f"cycle {k}",
                f"axis_of_cycle names {axis}, but the gyros turn about {turns} "
                f"({float(power.max()) / total:.0%} of the mean square rate)",
            )
