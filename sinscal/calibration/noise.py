"""White noise of a rig run from its own readings, where its sidecar does not state it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import comb, sqrt

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.steps import Filtered
from sinscal.calibration.consistency import ALONG, rows_of_rig
from sinscal.filter.data import COUNT, RigNoise
from sinscal.recording.run import RigFacts, RigRun

BLOCK_S = 0.25  # over which readings are averaged first: quantisation is then nothing
# Or less, where the run turns fast: gravity must look straight over a few. The gyros see only the
# earth's rate go round: of its 15 °/h a turn of 0.1 rad a block leaves 0.003 °/h.
BLOCK_TURN_RAD, GYRO_TURN_RAD = 0.02, 0.1
ORDER = 3  # of the differences in which the motion vanishes
# The motor changes its rate where the rate's differences are beyond so many of their medians: there
# misalignments carry the motion into every sensor.
RATE_CHANGES = 10.0
ROBUST = 0.6745  # median of |x| in sigmas
# Variance of the logarithm of a sigma by the median of n third differences, times n: 1/(2 · 0.37)
# if they were independent (0.37: the efficiency of a median), times 2.3, the sum of their squared
# correlations (-15/20, 6/20, -1/20).
MEDIAN_VARIANCE = 3.1
# A counter's fourth differences over third ones of independent means, as variances.
COUNTED = comb(2 * ORDER + 2, ORDER + 1) / comb(2 * ORDER, ORDER)
DROWNED = 0.1  # of what is measured: noise below it is drowned by a counter's
UNEVEN = 0.1  # of a counter's share: what is left over is not normal, nor always evenly spread
# Of noise that spreads readings over steps, with their rounding, over the rounding: a sigma of half
# a step, at which the mean of rounded readings is right to 0.2 % of a step.
SPREAD = 1.0 + 0.5**2 * COUNT
LEAST = 1e-3  # of what was guessed: no estimate falls below


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFound:
    """The noise of a run, and the names of the densities that had to be estimated.

    `misstated` are those that are stated, each with the factor by which it is larger; `coarse` the
    sensors whose readings are rounded to steps that their noise does not spread over.
    """

    noise: RigNoise
    estimated: tuple[str, ...]
    misstated: Mapping[str, float] = field(default_factory=dict[str, float])
    coarse: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that the result carries."""
        wrong = tuple(
            f"noise_misstated: {name} noise is {factor:.2f} times the stated value; it was "
            f"estimated from the run"
            for name, factor in self.misstated.items()
        )
        wrong += tuple(
            f"coarse_steps: readings of the {name} are rounded to steps larger than twice their "
            "noise: rounding does not average out, and constant errors may be wrong by half a "
            "step; record increments, or with a finer step"
            for name in self.coarse
        )
        unstated = [name for name in self.estimated if name not in self.misstated]
        if not unstated:
            return wrong
        what = ", ".join(unstated)
        return (
            *wrong,
            f"noise_estimated: {what} noise is not stated in the sidecar and was estimated from "
            f"the run; NIS is then no test, but whiteness and the held-out cycle are",
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

    quantum = facts.quantum

    def density(
        name: str, stated: float | None, found: Callable[[RigRun], Density], rounded: float = 0.0
    ) -> float:
        if stated:
            return sqrt(stated**2 + rounding_density2(run, rounded))
        estimated.append(name)
        return found(run).value

    noise = RigNoise(
        gyro=density("gyro", facts.gyro_noise, gyro_density, quantum.gyro_rad_s),
        accel=density("accelerometer", facts.accel_noise, accel_density, quantum.accel_m_s2),
        angle=density("angle", facts.angle_noise, angle_density) if angle else 0.0,
        gyro_quantum=quantum.gyro_rad,
        accel_quantum=quantum.accel_m_s,
    )
    rounded = (("gyros", noise.gyro, quantum.gyro_rad_s),
               ("accelerometers", noise.accel, quantum.accel_m_s2))  # fmt: skip
    coarse = tuple(n for n, d, step in rounded if d**2 < SPREAD * rounding_density2(run, step))
    return NoiseFound(noise=noise, estimated=tuple(estimated), coarse=coarse)


@dataclass(frozen=True, slots=True, kw_only=True)
class Density:
    """A density of white noise and its sigma."""

    value: float
    sigma: float


def gyro_density(run: RigRun) -> Density:
    """Return the gyros' density, rad/s/√Hz: of those across the rotation, which see no motor."""
    parts: list[FloatArray] = []
    for rows in run.cycles:
        gyro = run.gyro[rows]
        across = np.argsort(np.mean(gyro**2, axis=0))[:2]
        parts.append(gyro[:, across])
    return _density(run, parts, GYRO_TURN_RAD, run.facts.quantum.gyro_rad)


def accel_density(run: RigRun) -> Density:
    """Return the accelerometers' density, m/s²/√Hz."""
    counted = run.facts.quantum.accel_m_s
    return _density(run, [run.accel[rows] for rows in run.cycles], BLOCK_TURN_RAD, counted)


def angle_density(run: RigRun) -> Density:
    """Return the density of the rig's angle, rad/√Hz."""
    assert run.rig_angle_rad is not None
    angles = [np.unwrap(run.rig_angle_rad[rows])[:, None] for rows in run.cycles]
    return _density(run, angles, BLOCK_TURN_RAD)


def rounding_density2(run: RigRun, step: float) -> float:
    """Return the square of the density that rounding every reading to a step adds."""
    return step**2 / COUNT * float(np.median(run.step_s))


def _density(
    run: RigRun, parts: Sequence[FloatArray], turn_rad: float, counted: float = 0.0
) -> Density:
    """Return the density of what third differences of short means leave: noise, not motion.

    `parts` are the readings of each cycle; `counted` is the step of a counter of their integral,
    whose share is taken out: its own fourth differences over the blocks.
    """
    found: list[FloatArray] = []
    share: list[float] = []
    count = 0
    for rows, values in zip(run.cycles, parts, strict=True):
        step_s = float(np.median(run.step_s[rows]))
        fastest = float(np.percentile(np.linalg.norm(run.gyro[rows], axis=1), 95))
        block_s = min(BLOCK_S, turn_rad / max(fastest, 1e-9))
        every = max(1, int(block_s / step_s))
        rate = _differences(np.linalg.norm(run.gyro[rows], axis=1)[:, None], every)[:, 0]
        calm = rate <= RATE_CHANGES * np.median(rate)
        size = _differences(values, every)[calm]
        found.append(np.median(size, axis=0) / ROBUST * np.sqrt(every * step_s))
        share.append(COUNTED / COUNT * counted**2 / (every * step_s))
        count += size.size
    total2, share2 = float(np.mean(np.square(found))), float(np.mean(share))
    value = max(sqrt(max(total2 - share2, DROWNED**2 * total2)), 1e-30)
    sigma = (total2 * sqrt(MEDIAN_VARIANCE / max(count, 1)) + UNEVEN * share2) / value
    return Density(value=value, sigma=sigma)


def _differences(values: FloatArray, every: int) -> FloatArray:
    """Return the sizes of third differences of means of so many readings, as one mean's noise."""
    part = values[: len(values) // every * every].reshape(-1, every, values.shape[1]).mean(axis=1)
    return np.abs(np.diff(part, ORDER, axis=0)) / np.sqrt(comb(2 * ORDER, ORDER))


# What is stated is not believed when the readings differ from it by more than so many sigmas and
# this share. Beyond the factor it is no inaccuracy: it contradicts the run.
MISSTATED_SIGMAS, MISSTATED_SHARE, CONTRADICTED = 5.0, 0.08, 1.5


def believed(stated: NoiseFound, run: RigRun) -> NoiseFound:
    """Return the noise with densities that are stated a little wrong measured instead.

    Third differences of short means hold no motion and no effect that a model may lack, so that
    what is missing does not pass for noise.
    """
    noise, wrong = stated.noise, dict[str, float]()
    for name, key, measure in (
        ("gyro", "gyro", gyro_density),
        ("accelerometer", "accel", accel_density),
    ):
        if name in stated.estimated:
            continue
        found, said = measure(run), float(getattr(noise, key))
        apart = abs(found.value - said)
        differs = apart > max(MISSTATED_SIGMAS * found.sigma, MISSTATED_SHARE * said)
        if differs and 1.0 / CONTRADICTED < found.value / said < CONTRADICTED:
            wrong[name] = found.value / said
            noise = replace(noise, **{key: found.value})
    return replace(stated, noise=noise, estimated=(*stated.estimated, *wrong), misstated=wrong)


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
