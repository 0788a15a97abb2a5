"""Signature of each missing effect in a calibration's innovations and result.

Sent through the filter's own gains, an effect of unknowns c leaves S·c in the normalised
innovations and B·c in the estimates. Of S only the information SᵀS and the score Sᵀr are kept, so
that a run of many hours needs no more memory than a short one. Unknowns are counted in the sigmas
that are expected of them beforehand.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from scipy.stats import chi2

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Theta
from errormodel.filter.gains import candidate_responses
from errormodel.linear import independent
from sinscal.calibration.effect_tests import EffectTest, EffectTests
from sinscal.calibration.rig import RigCalibration
from sinscal.filter.data import CycleData
from sinscal.library import rig_library
from sinscal.library.groups import RigEffect
from sinscal.library.jump import DRIFT_SIGMAS, fading
from sinscal.model.priors import prior_sigma
from sinscal.recording.run import RigRun
from sinscal.sensitivity.problem import EDGE_S, FilterProblem

STEP_TIMES = 24  # tried of a jump
# A constant error drifts evenly or fading with these shares of the run, or in waves of which this
# is the shortest.
RAMP = np.inf
FADING = (RAMP, 0.5, 0.25, 0.12, 0.06, 0.03)
WAVES = 6
WALK: Theta = ()
INDEPENDENT = 1e-6  # share of the largest eigenvalue below which a direction is rounding
SCALES = np.concatenate([[0.0], np.logspace(-4.0, 1.0, 51)])  # of effects, in expected sigmas
LEAST_INFORMATION = 1e-6  # in directions of one expected sigma


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EffectView:
    """One effect, of one shape in time, before a calibration that lacks it.

    Attributes
    ----------
    effect : RigEffect
    names : tuple of str, length k
        Of its unknowns.
    theta : tuple of float
        Time of a jump, s; share of the run over which a drift fades; empty otherwise.
    strengths : ndarray, shape (k,)
        Eigenvalues of the information; those of directions that do not show are zero.
    scores : ndarray, shape (k,)
        What the innovations show along the eigenvectors.
    errors : ndarray, shape (p, k)
        Estimate less truth of every parameter reported, per eigenvector.
    axes : ndarray, shape (k, k)
        The eigenvectors, as columns, in SI per expected sigma.
    """

    effect: RigEffect
    names: tuple[str, ...]
    theta: Theta
    strengths: FloatArray
    scores: FloatArray
    errors: FloatArray
    axes: FloatArray

    @property
    def dof(self) -> int:
        """In how many directions the effect shows."""
        return int(np.sum(self.strengths > 0.0))

    @property
    def chi2(self) -> float:
        """χ² that the effect explains."""
        seen = self.strengths > 0.0
        return float(np.sum(self.scores[seen] ** 2 / self.strengths[seen]))

    def likelihood(self, variance: float) -> FloatArray:
        """Return by how much the effect raises the log likelihood at every size of `SCALES`.

        Its unknowns are N(0, s² expected²): an effect of many gains nothing by their number.
        """
        s2 = np.square(SCALES)[:, None]
        more = s2 * self.strengths / variance
        shown = s2 * self.scores**2 / variance**2
        return 0.5 * np.sum(shown / (1.0 + more) - np.log1p(more), axis=1)

    @property
    def size(self) -> FloatArray:
        """The unknowns that explain most, SI, shape (k,)."""
        seen = self.strengths > 0.0
        return self.axes[:, seen] @ (self.scores[seen] / self.strengths[seen])


def in_model(effect: RigEffect, found: RigCalibration) -> bool:
    """Return whether a calibration's model has an effect."""
    groups = {one.group for one in found.sensors.parameters.values()}
    if effect.groups:
        return set(effect.groups) <= groups
    if effect.step:
        return effect.name in groups
    return effect.drift is None  # the mounting


def effects_not_in_model(run: RigRun, found: RigCalibration) -> tuple[RigEffect, ...]:
    """Return the library's effects that a calibration's model lacks and its run could show."""
    angle = found.layout.angle
    lacking = (e for e in rig_library().by_name.values() if not in_model(e, found))
    return tuple(e for e in lacking if e.recorded(run, angle=angle))


def effect_views(
    run: RigRun,
    found: RigCalibration,
    cycles: tuple[CycleData, ...],
    given: Mapping[str, float] | None = None,
) -> tuple[EffectView, ...]:
    """Return what every effect that is missing would do, in every shape that is tried of it.

    Parameters
    ----------
    run : RigRun
    found : RigCalibration
    cycles : tuple of CycleData
        The run cut as for the calibration.
    given : mapping of str to float, optional
        Sigmas expected beforehand by group or name instead of the usual ones, SI.
    """
    effects = effects_not_in_model(run, found)
    problem = FilterProblem(run, found, cycles, effects)
    bearing = independent(problem.bearing())
    residual = problem.residual - bearing @ (bearing.T @ problem.residual)
    sigma = np.sqrt(found.filtered.variance[problem.kept])
    order = found.layout.reported

    def viewed(effect: RigEffect, theta: Theta, names: list[str], size: FloatArray,
               h: FloatArray, phi: FloatArray) -> EffectView:  # fmt: skip
        seen, left = candidate_responses(problem.steps, problem.gains, h * size, phi * size)
        columns = seen[problem.kept] / sigma[:, None]
        columns -= bearing @ (bearing.T @ columns)
        strengths, axes = np.linalg.eigh(columns.T @ columns)
        least = max(INDEPENDENT * float(strengths[-1]), LEAST_INFORMATION)
        return EffectView(
            effect=effect,
            names=tuple(names),
            theta=theta,
            strengths=np.where(strengths > least, strengths, 0.0),
            scores=axes.T @ (columns.T @ residual),
            errors=-left[order] @ axes,
            axes=size[:, None] * axes,
        )

    return tuple(
        viewed(effect, *shape)
        for effect in effects
        for shape in _shapes(problem, effect, given or {})
    )


def _shapes(
    problem: FilterProblem, effect: RigEffect, given: Mapping[str, float]
) -> Iterator[tuple[Theta, list[str], FloatArray, FloatArray, FloatArray]]:
    """Yield each shape of an effect: θ, names, expected sigmas, columns of h and of φ.

    What changes in time is counted from its mean over the run: the rest is a constant error.
    """
    names, h, phi = problem.columns_of(effect)
    if not (effect.step or effect.drift):
        size = problem.prior_sigmas(effect, given)
        yield (), names, size, h, phi
        return
    for theta, waves, sizes in _courses(problem, effect, given):
        waves = waves - waves[problem.found.cycle_of_step >= 0].mean(axis=0)
        wide = [
            (a[:, :, :, None] * waves[:, None, None, :]).reshape(*a.shape[:2], -1) for a in (h, phi)
        ]
        yield theta, [n for n in names for _ in sizes], np.tile(sizes, len(names)), *wide


def _courses(
    problem: FilterProblem, effect: RigEffect, given: Mapping[str, float]
) -> Iterator[tuple[Theta, FloatArray, FloatArray]]:
    """Yield courses in time: θ, columns (K, w) and their expected sigmas (w,)."""
    at, span_s = problem.elapsed_s, float(np.ptp(problem.elapsed_s))
    if effect.step:
        constant = rig_library().told[effect.constant_error]
        sizes = np.array([prior_sigma(constant, given)])
        first, last = float(at[0]) + EDGE_S, float(at[-1]) - EDGE_S
        for time_s in np.linspace(first, last, STEP_TIMES).tolist():
            yield (time_s,), problem.share_after(time_s)[:, None], sizes
        return
    assert effect.drift
    sigma = DRIFT_SIGMAS[effect.drift]
    for share in FADING:
        course = fading(at - at[0], share * span_s, span_s)
        yield (share,), course[:, None], np.array([sigma])
    orders = np.arange(1, WAVES + 1)
    yield WALK, np.cos(np.pi * np.outer((at - at[0]) / span_s, orders)), sigma / orders


def by_effect(views: Sequence[EffectView]) -> dict[str, list[EffectView]]:
    """Return the shapes of each effect that shows at all."""
    out: dict[str, list[EffectView]] = {}
    for view in views:
        if view.dof:
            out.setdefault(view.effect.name, []).append(view)
    return out


def tested_effects(views: Sequence[EffectView], variance: float) -> EffectTests:
    """Test every effect.

    Parameters
    ----------
    views : sequence of EffectView
    variance : float
        Of the normalised innovations, 1 where the noise is as stated.
    """
    found = [_tested(name, shapes, variance) for name, shapes in by_effect(views).items()]
    return EffectTests(tests=tuple(sorted(found, key=lambda t: -t.evidence)))


def _tested(name: str, shapes: Sequence[EffectView], variance: float) -> EffectTest:
    p_values = [float(chi2.sf(v.chi2 / variance, v.dof)) for v in shapes]
    likelihood = np.array([v.likelihood(variance) for v in shapes])
    most = likelihood.max(axis=1)
    k = int(np.argmax(most))
    best = shapes[k]
    alone = len({*best.names}) == len(best.names)
    return EffectTest(
        name=name,
        chi2=best.chi2 / variance,
        dof=best.dof,
        p_value=min(1.0, len(shapes) * min(p_values)),
        likelihood=float(most[k]),
        evidence=float(logsumexp(most)) - np.log(len(shapes)),
        scale=float(SCALES[np.argmax(likelihood[k])]),
        theta=best.theta,
        sizes=dict(zip(best.names, best.size.tolist(), strict=True)) if alone else {},
    )
