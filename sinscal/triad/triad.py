"""An accelerometer triad from rests in many positions: wherever it points, |f| is gravity.

    f = T·K·(a − b),    |f| = g in every position

a is the reading (any unit), b the bias in the same unit, K the three scales, (m/s²) per unit, and
T unit triangular: its three entries are the misalignments. |f| does not change when the whole
triad turns, so only a triangle of them can be had; which one fixes the axes. Lower: x is along the
first sensor, y in the plane of the first two. Upper: z is along the third.

Noise of a position's |f| is that of the mean over its rows plus a scatter from position to
position (what does not average out within one: slow drift, a table that gives way), found so that
χ² is its degrees of freedom (Paule and Mandel).

References
----------
D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration
without external equipments", ICRA 2014 (upper form, equal weights); R. C. Paule and J. Mandel,
J. Res. Natl. Bur. Stand. 87 (1982) 377.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray, IntArray, freeze, readonly
from errormodel.errors import InputError, NotSeparableError
from sinscal.recording.run import AXES
from sinscal.triad.model import TriadModel, parameter_names, start_values

Gauge: TypeAlias = Literal["lower", "upper"]

OUTLIER_RISK = 0.01  # that any sound position at all is left out
MOST_LEFT_OUT = 0.2
CONDITION = 1e-4  # smallest over largest singular value of the scaled equations
ITERATIONS = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOutPosition:
    """A position that does not fit the others: which one, its |f| − g, and in how many sigmas."""

    position: int
    residual_m_s2: float
    sigmas: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TriadFit:
    """A triad with its covariance; `names` labels values, and both axes of `cov`.

    Attributes
    ----------
    names : tuple of str
        scale_x… ((m/s²) per unit), misalignment_xy… (rad; row, column of T), bias_x… (unit), and
        with temperature bias_t_x… (unit/°C), scale_t_x… (1/°C).
    values, cov : ndarray
    model : TriadModel
        Applies the values.
    gravity_m_s2 : float
    used : ndarray of int
        The positions fitted.
    residual_m_s2 : ndarray, shape (k,)
        |f| − g of all positions, those left out too.
    within_m_s2 : ndarray, shape (k,)
        Sigma of each from the noise of its rows.
    pose_m_s2 : float
        Sigma from position to position beside it.
    chi2, dof : float, int
        Of the fit with the noise of the rows alone.
    singular_values : ndarray
        Of the equations with each column scaled to one.
    left_out : tuple of LeftOutPosition
    t_ref_c : float, optional
    """

    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    model: TriadModel
    gravity_m_s2: float
    used: IntArray
    residual_m_s2: FloatArray
    within_m_s2: FloatArray
    pose_m_s2: float
    chi2: float
    dof: int
    singular_values: FloatArray
    left_out: tuple[LeftOutPosition, ...]
    t_ref_c: float | None = None

    def __post_init__(self) -> None:
        names = ("values", "cov", "residual_m_s2", "within_m_s2", "singular_values")
        freeze(self, **{name: readonly(getattr(self, name)) for name in names})

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations of `values`."""
        return np.sqrt(np.diag(self.cov))

    @property
    def rms_m_s2(self) -> float:
        """Root mean square of the fitted residuals, m/s²."""
        return float(np.sqrt(np.mean(self.residual_m_s2[self.used] ** 2)))

    def value(self, name: str) -> float:
        """Return one value by its name."""
        return float(self.values[self.names.index(name)])

    def sigma(self, name: str) -> float:
        """Return one standard deviation by its name."""
        return float(self.sigmas[self.names.index(name)])


def fit_triad(
    means: FloatArray,
    rows: IntArray,
    noise: FloatArray,
    gravity_m_s2: float,
    *,
    gauge: Gauge = "lower",
    temp_c: FloatArray | None = None,
    mean_sigma: FloatArray | None = None,
    source: str = "the recording",
) -> TriadFit:
    """Fit a triad to mean readings at rest.

    Parameters
    ----------
    means : ndarray, shape (k, 3)
        Mean reading in each position, any unit.
    rows : ndarray of int, shape (k,)
        Rows that each is the mean of.
    noise : ndarray, shape (3,)
        Sigma of one row at rest, same unit.
    gravity_m_s2 : float
        At the place.
    gauge : str
        "lower" or "upper": which triangle the misalignments stand in.
    temp_c : ndarray, shape (k,), optional
        Adds slopes of bias and scale over temperature, about the mean.
    mean_sigma : ndarray, shape (3,), optional
        Sigma of a mean that more rows do not reduce, same unit; 0 if not given.

    Returns
    -------
    TriadFit

    Raises
    ------
    InputError
        If there are fewer positions than unknowns.
    NotSeparableError
        If the positions cannot tell the unknowns apart; it names them.
    """
    names = parameter_names(gauge, temp_c is not None)
    if means.shape[0] < len(names):
        raise InputError(
            source, "", f"{means.shape[0]} positions at rest, expected {len(names)} at least"
        )
    t_ref_c = None if temp_c is None else float(np.mean(temp_c))
    warm = np.zeros(means.shape[0]) if temp_c is None else temp_c - float(np.mean(temp_c))
    lasting = np.zeros(3) if mean_sigma is None else mean_sigma
    problem = _Problem(means, rows, noise, lasting, gravity_m_s2, gauge, warm, names)
    values = start_values(means, gravity_m_s2, gauge, source)
    values = np.concatenate([values, np.zeros(len(names) - values.size)])
    used: IntArray = np.arange(means.shape[0], dtype=np.intp)
    left_out: list[LeftOutPosition] = []
    while True:
        values, pose = problem.solve(values, used, source)
        worst = _worst(problem, values, pose, used)
        if worst is None or len(left_out) >= MOST_LEFT_OUT * means.shape[0]:
            break
        left_out.append(worst)
        used = np.array([k for k in used.tolist() if k != worst.position], dtype=np.intp)
    return _result(problem, values, pose, used, left_out, t_ref_c, source)


@dataclass(frozen=True, slots=True)
class _Problem:
    means: FloatArray
    rows: IntArray
    noise: FloatArray
    lasting: FloatArray
    gravity_m_s2: float
    gauge: Gauge
    warm: FloatArray
    names: tuple[str, ...]

    def model(self, values: FloatArray) -> TriadModel:
        return TriadModel.of(values, self.gauge)

    def within2(self, values: FloatArray) -> FloatArray:
        """Variance of each |f| from the noise and the resolution of its rows."""
        model = self.model(values)
        force = model.apply(self.means, self.warm)
        along = force @ model.matrix / np.linalg.norm(force, axis=1)[:, None]
        of_rows = np.sum((along * self.noise) ** 2, axis=1) / self.rows
        return of_rows + np.sum((along * self.lasting) ** 2, axis=1)

    def equations(self, values: FloatArray, used: IntArray) -> tuple[FloatArray, FloatArray]:
        model = self.model(values)
        force, jacobian = model.magnitude(self.means[used], self.warm[used])
        return force - self.gravity_m_s2, jacobian[:, : len(self.names)]

    def solve(self, values: FloatArray, used: IntArray, source: str) -> tuple[FloatArray, float]:
        """Gauss and Newton with weights that follow the scatter between positions."""
        pose2 = 0.0
        for k in range(ITERATIONS):
            residual, jacobian = self.equations(values, used)
            within2 = self.within2(values)[used]
            weight = 1.0 / np.sqrt(within2 + pose2)
            _check_separable(jacobian * weight[:, None], self.names, source)
            step = np.linalg.lstsq(jacobian * weight[:, None], -residual * weight)[0]
            values = values + step
            predicted = residual + jacobian @ step
            pose2 = paule_mandel(predicted, within2, used.size - len(self.names))
            scale = np.linalg.norm(jacobian * weight[:, None], axis=0)
            if k > 2 and float(np.max(np.abs(step) * scale)) < 1e-6:
                return values, float(np.sqrt(pose2))
        raise InputError(
            source, "", f"the fit of the triad does not converge in {ITERATIONS} steps"
        )


def paule_mandel(residual: FloatArray, within2: FloatArray, dof: int) -> float:
    """Return the variance to add to `within2` that makes χ² its degrees of freedom, if any."""

    def chi2(extra: float) -> float:
        return float(np.sum(residual**2 / (within2 + extra)))

    if dof < 1 or chi2(0.0) <= dof:
        return 0.0
    low, high = 0.0, float(np.sum(residual**2)) / dof
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chi2(middle) > dof else (low, middle)
        if high - low < 1e-12 * high:
            break
    return high


def _check_separable(scaled: FloatArray, names: tuple[str, ...], source: str) -> FloatArray:
    norms = np.linalg.norm(scaled, axis=0)
    if not np.all(norms > 0):
        raise NotSeparableError([[n] for n, s in zip(names, norms, strict=True) if s == 0], source)
    _, s, vt = np.linalg.svd(scaled / norms, full_matrices=False)
    weak = vt[s < CONDITION * s[0]]
    if weak.size:
        groups = [[names[k] for k in np.flatnonzero(np.abs(v) > 0.3)] for v in weak]
        raise NotSeparableError(
            groups, f"{source}: the positions (more of them, in other orientations)"
        )
    return s


def _worst(
    problem: _Problem, values: FloatArray, pose: float, used: IntArray
) -> LeftOutPosition | None:
    """Return the position that stands out: its residual against a fit without it."""
    dof = used.size - len(problem.names)
    if dof < 2:
        return None
    residual, jacobian = problem.equations(values, used)
    weight = 1.0 / np.sqrt(problem.within2(values)[used] + pose**2)
    q, _ = np.linalg.qr(jacobian * weight[:, None])
    left = np.maximum(1.0 - np.sum(q**2, axis=1), 1e-9)
    z = residual * weight / np.sqrt(left)
    total = float(np.sum((residual * weight) ** 2))
    without = np.maximum(total - z**2, 1e-12 * max(total, 1e-300)) / (dof - 1)
    # with the rows' noise alone (no scatter between positions) its size is known, not estimated
    t = np.abs(z) / np.sqrt(np.maximum(without, 0.0 if pose > 0 else 1.0))
    k = int(np.argmax(t))
    limit = float(stats.t.isf(OUTLIER_RISK / (2 * used.size), dof - 1))
    if t[k] < limit:
        return None
    return LeftOutPosition(
        position=int(used[k]), residual_m_s2=float(residual[k]), sigmas=float(t[k])
    )


def _result(
    problem: _Problem,
    values: FloatArray,
    pose: float,
    used: IntArray,
    left_out: list[LeftOutPosition],
    t_ref_c: float | None,
    source: str,
) -> TriadFit:
    residual, jacobian = problem.equations(values, used)
    within2 = problem.within2(values)
    weight = 1.0 / np.sqrt(within2[used] + pose**2)
    scaled = jacobian * weight[:, None]
    singular = _check_separable(scaled, problem.names, source)
    every, _ = problem.equations(values, np.arange(problem.rows.size))
    return TriadFit(
        names=problem.names,
        values=values,
        cov=np.linalg.inv(scaled.T @ scaled),
        model=problem.model(values),
        gravity_m_s2=problem.gravity_m_s2,
        used=used,
        residual_m_s2=every,
        within_m_s2=np.sqrt(within2),
        pose_m_s2=pose,
        chi2=float(np.sum(residual**2 / within2[used])),
        dof=used.size - values.size,
        singular_values=singular,
        left_out=tuple(left_out),
        t_ref_c=t_ref_c,
    )


def errors_of(fit: TriadFit) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Return a lower fit of readings in m/s² as the errors f′ = (I + Γ)f + Δf⁰, with covariance.

    Returns
    -------
    names : tuple of str
        accel_bias_x… (m/s²), accel_scale_x…, accel_misalignment_yx, …zx, …zy.
    values, cov : ndarray
    """
    if fit.model.gauge != "lower":
        raise ValueError("expected a fit in the lower form")
    names = (
        *(f"accel_bias_{a}" for a in AXES),
        *(f"accel_scale_{a}" for a in AXES),
        *(f"accel_misalignment_{a}" for a in ("yx", "zx", "zy")),
    )

    def errors(values: FloatArray) -> FloatArray:
        model = TriadModel.of(values, "lower")
        gamma = np.linalg.inv(model.matrix) - np.eye(3)
        return np.concatenate([model.bias, np.diag(gamma), gamma[[1, 2, 2], [0, 0, 1]]])

    at = fit.values[:9]
    steps = np.maximum(1e-4 * fit.sigmas[:9], 1e-12)
    jacobian = np.column_stack(
        [
            (errors(at + h * e) - errors(at - h * e)) / (2 * h)
            for h, e in zip(steps, np.eye(9), strict=True)
        ]
    )
    return names, errors(at), jacobian @ fit.cov[:9, :9] @ jacobian.T
