"""Test of a rig's estimates against the chamber's models, with explanations of a contradiction.

An estimate in which the chamber's coefficients are hardly held (`wide`) is compared with the
chamber: had the chamber been right, their difference would have a known covariance. It is linear,
about the combined calibration: where the chamber is right, that is where the truth is, while an
iteration of its own would run to the far ends of what the rig hardly sees. When chamber and rig
contradict each other, each explanation in turn is put in the chamber's place: two serial numbers
exchanged, a thermistor that reads too high.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from scipy.stats import chi2

from errormodel.arrays import FloatArray
from sinscal.model.chamber import ChamberModel, chamber_names
from sinscal.model.motion import Motion
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import AXES

FALSE_ALARM = 1e-3
# An explanation is named when it takes away this share of the excess of χ² …
NAMED_SHARE = 0.9
# … and an offset is worth telling above this: less is what thermistors are good for.
OFFSET_C = 0.2
# Directions in which the rig takes away less than this share of the wide prior's variance are left
# out: a coefficient as far off as that prior allows would move them by a tenth of their sigma.
SEEN = 0.01
TEMPERATURE_STEP_C = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberTest:
    """The comparison of rig and chamber.

    Attributes
    ----------
    chi2, dof, p_value
        Of the difference, had the chamber been right.
    contradictions : tuple of str
        What is wrong, in words; empty when nothing contradicts.
    """

    chi2: float
    dof: int
    p_value: float
    contradictions: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Comparison:
    """difference = wide estimate − chamber; what the wide filter passes on of a change; factor."""

    difference: FloatArray
    passed: FloatArray
    root: FloatArray  # whitens: rows of rank

    def chi2(self, change: FloatArray) -> float:
        """Return χ² when the truth differs from the chamber by `change`."""
        left = self.root @ (self.difference - self.passed @ change)
        return float(left @ left)


def compare_with_chamber(
    sensors: SensorModel,
    chambers: Sequence[ChamberModel],
    motions: Sequence[Motion],
    values: FloatArray,
    cov: FloatArray,
    wide_cov: FloatArray,
    known_cov: FloatArray,
) -> ChamberTest:
    """Compare a wide estimate with the chamber's models it was centred on.

    Parameters
    ----------
    sensors : SensorModel
        From `combined_sensors`.
    chambers : sequence of three ChamberModel
    motions : sequence of Motion
        What the sensors went through, corrected; for what a thermistor's offset would do.
    values, cov : ndarray
        The wide estimate's, in the order of `sensors.names`.
    wide_cov : ndarray, shape (p, p)
        Its prior covariance.
    known_cov : ndarray, shape (p, p)
        The chamber's covariance, with what may have changed since.

    Returns
    -------
    ChamberTest
    """
    names = chamber_names(sensors, chambers)
    at = np.array([sensors.names.index(n) for n in names])
    prior = np.concatenate([c.without_mounting().values for c in chambers])
    chamber_cov = known_cov[np.ix_(at, at)]
    after, before = cov[np.ix_(at, at)], wide_cov[np.ix_(at, at)]
    passed = np.eye(at.size) - after @ np.linalg.inv(before)
    total = passed @ chamber_cov @ passed.T + passed @ after
    comparison = _Comparison(
        difference=values[at] - prior,
        passed=passed,
        root=_whitener(total, after, np.sqrt(np.diag(before))),
    )
    dof = comparison.root.shape[0]
    found = comparison.chi2(np.zeros(at.size))
    p_value = float(chi2.sf(found, dof))
    told: tuple[str, ...] = ()
    if p_value < FALSE_ALARM:
        told = _explained(sensors, chambers, motions, values, comparison, prior, found, dof)
    return ChamberTest(chi2=found, dof=dof, p_value=p_value, contradictions=told)


def _whitener(total: FloatArray, after: FloatArray, wide: FloatArray) -> FloatArray:
    """Return W of full rank with W·total·Wᵀ = 1, of the directions that the rig can show.

    They are chosen by sigmas alone, so that the choice does not follow the data.
    """
    share, directions = np.linalg.eigh(np.eye(wide.size) - after / np.outer(wide, wide))
    seen = directions[:, share > SEEN].T / wide
    cov = seen @ total @ seen.T
    size = np.sqrt(np.diag(cov))
    lower = np.linalg.cholesky(cov / np.outer(size, size))
    return np.linalg.solve(lower, seen / size[:, None])


def _explained(
    sensors: SensorModel,
    chambers: Sequence[ChamberModel],
    motions: Sequence[Motion],
    values: FloatArray,
    comparison: _Comparison,
    prior: FloatArray,
    found: float,
    dof: int,
) -> tuple[str, ...]:
    """Return what contradicts, the best explanation first."""
    head = f"the rig contradicts the chamber's models (χ² {found:.4g} of {dof})"
    enough = found - NAMED_SHARE * (found - dof)
    exchanged = _best_exchange(chambers, comparison, prior)
    offset = _best_offset(sensors, chambers, motions, values, comparison, found)
    explanations = sorted([exchanged, offset], key=lambda e: e[0])
    told = [f"{text} (χ² falls to {value:.4g})" for value, text in explanations if value <= enough]
    if told:
        return (f"{head}: {told[0]}", *told[1:])
    return (f"{head}; neither exchanged serial numbers nor a thermistor offset explain it",)


def _best_exchange(
    chambers: Sequence[ChamberModel], comparison: _Comparison, prior: FloatArray
) -> tuple[float, str]:
    best = (np.inf, "")
    parts = [c.without_mounting() for c in chambers]
    mine = [dict(zip(p.model.names, p.values.tolist(), strict=True)) for p in parts]
    for order in permutations(range(3)):
        if order == (0, 1, 2):
            continue
        # what the other's model does not have is zero in it; what only it has is left out
        there = [mine[order[k]].get(n, 0.0) for k in range(3) for n in parts[k].model.names]
        change = np.array(there) - prior
        value = comparison.chi2(change)
        if value < best[0]:
            moved = [k for k in range(3) if order[k] != k]
            who = ", ".join(
                f"{chambers[order[k]].serial} is on {AXES[k]}, not on {AXES[order[k]]}"
                for k in moved
            )
            best = (value, f"serial numbers are exchanged: {who}")
    return best


def _best_offset(
    sensors: SensorModel,
    chambers: Sequence[ChamberModel],
    motions: Sequence[Motion],
    values: FloatArray,
    comparison: _Comparison,
    found: float,
) -> tuple[float, str]:
    """Return the thermistor offset that explains most: of one accelerometer, or of all alike."""
    columns = [_offset_change(sensors, chambers, motions, values, k) for k in range(3)]
    seen = comparison.root @ comparison.difference
    tries = [(AXES[k], columns[k]) for k in range(3)] + [("all three", sum(columns))]
    best = (np.inf, "")
    for who, column in tries:
        sent = comparison.root @ comparison.passed @ np.asarray(column)
        information = float(sent @ sent)
        if information <= 0.0:
            continue
        size = float(sent @ seen) / information
        value = found - size**2 * information
        if abs(size) > OFFSET_C and value < best[0]:
            side = "high" if size > 0 else "low"
            text = (
                f"the thermistor of {who} reads {abs(size):.2f} ± {information**-0.5:.2g} °C too "
                f"{side}"
            )
            best = (value, text)
    return best


def _offset_change(
    sensors: SensorModel,
    chambers: Sequence[ChamberModel],
    motions: Sequence[Motion],
    values: FloatArray,
    axis: int,
) -> FloatArray:
    """Return how the chamber's coefficients seem to change per °C that a thermistor reads high."""
    names = chamber_names(sensors, chambers)
    own = [n for n in names if sensors.parameters[n].axis == AXES[axis]]
    at = [sensors.names.index(n) for n in own]
    design: list[FloatArray] = []
    slope: list[FloatArray] = []
    for motion in motions:
        columns = sensors.columns(motion, values)
        design.append(columns[:, at])
        low, high = (
            sensors.errors(_warmer(motion, axis, s * TEMPERATURE_STEP_C), values)[:, 3 + axis]
            for s in (-1.0, 1.0)
        )
        slope.append((high - low) / (2.0 * TEMPERATURE_STEP_C))
    joint = np.vstack(design)
    norms: FloatArray = np.sqrt(np.sum(joint**2, axis=0))
    norms[norms == 0.0] = 1.0
    inverse = np.linalg.pinv(joint / norms, 1e-10)
    change = -(inverse @ np.concatenate(slope)) / norms
    out = np.zeros(len(names))
    out[[names.index(n) for n in own]] = change
    return out


def _warmer(motion: Motion, axis: int, by_c: float) -> Motion:
    assert motion.temp_c is not None
    temp_c = np.array(motion.temp_c)
    temp_c[:, axis] += by_c
    return replace(motion, temp_c=temp_c)
