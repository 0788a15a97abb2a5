"""White noise of a rig run from its own readings, where its sidecar does not state it."""

from dataclasses import dataclass, replace
from math import comb

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filtering import Filtered
from sinscal.consistency import ALONG, rows_of_rig
from sinscal.rigdata import RigNoise
from sinscal.run import RigFacts, RigRun

BLOCK_S = 0.25  # over which readings are averaged first: quantisation is then nothing
BLOCK_TURN_RAD = 0.02  # or less, where the run turns fast: gravity must look straight over a few
ORDER = 3  # of the differences in which the motion vanishes
ROBUST = 0.6745  # median of |x| in sigmas
LEAST = 1e-3  # of what was guessed: no estimate falls below


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFound:
    """The noise of a run, and the names of the densities that had to be estimated."""

    noise: RigNoise
    estimated: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a result must say of it."""
        if not self.estimated:
            return ()
        what = ", ".join(self.estimated)
        return (
            f"noise_estimated: {what} noise is not stated in the sidecar and was taken from the "
            f"run itself; NIS then says nothing, whiteness and the cycle held out do",
        )


def noise_of_run(run: RigRun, *, angle: bool) -> NoiseFound:
    """Return the densities that a run's facts state, and estimates of those they do not.

    Parameters
    ----------
    run : RigRun
    angle : bool
        Whether the rig's angle is used.
    """
    facts: RigFacts = run.facts
    estimated: list[str] = []

    def density(name: str, stated: float | None, values: FloatArray | None) -> float:
        if stated or values is None:
            return stated or 0.0
        estimated.append(name)
        return _density(run, values)

    noise = RigNoise(
        gyro=density("gyro", facts.gyro_noise, run.gyro),
        accel=density("accelerometer", facts.accel_noise, run.accel),
        angle=density("angle", facts.angle_noise, _angle(run) if angle else None),
    )
    return NoiseFound(noise=noise, estimated=tuple(estimated))


def _angle(run: RigRun) -> FloatArray:
    assert run.rig_angle_rad is not None
    return np.concatenate([np.unwrap(run.rig_angle_rad[rows])[:, None] for rows in run.cycles])


def _density(run: RigRun, values: FloatArray) -> float:
    """Return the density of what third differences of short means leave: noise, not motion."""
    found: list[FloatArray] = []
    for rows in run.cycles:
        step_s = float(np.median(run.step_s[rows]))
        fastest = float(np.percentile(np.linalg.norm(run.gyro[rows], axis=1), 95))
        block_s = min(BLOCK_S, BLOCK_TURN_RAD / max(fastest, 1e-9))
        every = max(1, int(block_s / step_s))
        part = values[rows]
        part = part[: len(part) // every * every].reshape(-1, every, part.shape[1]).mean(axis=1)
        size = np.abs(np.diff(part, ORDER, axis=0)) / np.sqrt(comb(2 * ORDER, ORDER))
        found.append(np.median(size, axis=0) / ROBUST * np.sqrt(every * step_s))
    return max(float(np.sqrt(np.mean(np.square(found)))), 1e-30)


def refined(before: NoiseFound, filtered: Filtered) -> NoiseFound:
    """Return the noise with the estimated densities put right by the innovations, robustly.

    The gyros' noise hardly shows in innovations: it stays as the differences gave it.
    """
    noise = before.noise
    size = np.abs(filtered.innovation) / np.sqrt(filtered.variance)
    names = rows_of_rig(size.shape[1]).names
    along = names.index(ALONG) if ALONG in names else None
    if "accelerometer" in before.estimated:
        noise = replace(noise, accel=noise.accel * _spread(size[:, :3]))
    if "angle" in before.estimated and along is not None:
        noise = replace(noise, angle=noise.angle * _spread(size[:, along]))
    return replace(before, noise=noise)


def _spread(size: FloatArray) -> float:
    return max(float(np.nanmedian(size)) / ROBUST, LEAST)
