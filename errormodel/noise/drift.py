"""Noise of a channel: white noise plus slow drift, and how it is estimated.

Slow drift is an Ornstein-Uhlenbeck process (first-order Gauss-Markov) that starts afresh in each
run: stationary sigma `drift` and correlation time `drift_tau_s`. Treating it as white would make
every sigma of a bias several times too small. Whitening is the innovation sequence of the Kalman
filter of that process (the Cholesky factor of the covariance, in linear time), applied to the
observations and to every column alike.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

from errormodel.arrays import FloatArray
from errormodel.blocks import Blocked, Kept, parts_of_runs
from errormodel.linear import triangle_of
from errormodel.noise.whitening import Whitening
from errormodel.record import Record

HARDLY = 1e-6  # of the longest column: shorter, it is not there


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseModel:
    """White noise of sigma `white` per reading plus drift of sigma `drift`, correlated in time.

    Parameters
    ----------
    white : float
        Sigma of the part that is new in each reading, in the unit of the model's input.
    drift : float
        Stationary sigma of the slow part; 0 for white noise alone.
    drift_tau_s : float
        Correlation time of the slow part, s.
    """

    white: float
    drift: float = 0.0
    drift_tau_s: float = 3600.0

    @property
    def ratio2(self) -> float:
        """Variance of the drift over that of the white part."""
        return (self.drift / self.white) ** 2

    def whiten(self, record: Record, columns: FloatArray) -> FloatArray:
        """Return `columns` decorrelated and scaled to unit variance, shape as given (n, m)."""
        return self.whitening(columns.shape[1]).whiten(record, columns) / self.white

    def whitening(self, width: int) -> Whitening:
        """Return what decorrelates columns block by block, in units of `white`."""
        return Whitening(self.ratio2, self.drift_tau_s, width)

    def scaled(self, factor: float) -> "NoiseModel":
        """Return the same shape of noise, `factor` times as large."""
        return NoiseModel(
            white=self.white * factor, drift=self.drift * factor, drift_tau_s=self.drift_tau_s
        )

    def sample(self, record: Record, rng: np.random.Generator) -> FloatArray:
        """Draw noise for a record, shape (n,); each run's drift starts from its stationary law."""
        noise = self.white * rng.standard_normal(len(record))
        if self.drift == 0.0:
            return noise
        for readings in record.run_slices:
            keep = np.exp(-np.diff(record.time_s[readings]) / self.drift_tau_s)
            kicks = rng.standard_normal(keep.size + 1)
            state = kicks[0]
            drift = [state]
            for k, kick in zip(keep, kicks[1:], strict=True):
                state = k * state + np.sqrt(1.0 - k * k) * kick
                drift.append(state)
            noise[readings] += self.drift * np.array(drift)
        return noise


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFit:
    """The noise that a set of residuals shows.

    `support` are the other noise models the data allow, each with its share of the likelihood:
    sigmas that ignored how roughly drift is known from a few runs would be too small.
    """

    noise: NoiseModel
    support: tuple[tuple[float, NoiseModel], ...]


def estimate_noise(
    record: Record,
    residual: FloatArray,
    columns: FloatArray,
    *,
    own: bool = False,
    wary: bool = False,
) -> NoiseFit:
    """Estimate white noise and drift by restricted maximum likelihood (REML).

    The likelihood is that of the error contrasts, so what the fit of `columns` absorbed of the
    drift is accounted for. Drift correlation times between three sampling intervals and three
    times the longest run are searched.

    Parameters
    ----------
    record : Record
        Times and runs.
    residual : ndarray, shape (n,)
        Residual at some value of the coefficients (any: they are profiled out).
    columns : ndarray, shape (n, p)
        Derivative of the model by its unknowns.
    own : bool
        Whether each run has unknowns of its own; the noise is common to all runs either way. What
        differs from run to run is then not taken for drift.
    wary : bool
        Whether `support` holds the drift that the data do not exclude even where they show none;
        otherwise it is white noise alone there.

    Returns
    -------
    NoiseFit

    References
    ----------
    Harville, D. A. (1977), Maximum likelihood approaches to variance component estimation and to
    related problems, JASA 72, eq. for the restricted likelihood.
    """
    return estimate_noise_of(record, residual, Kept(columns), own=own, wary=wary)


def estimate_noise_of(
    record: Record,
    residual: FloatArray,
    columns: Blocked,
    *,
    own: bool = False,
    wary: bool = False,
    own_columns: Sequence[int] = (),
) -> NoiseFit:
    """Estimate the noise as `estimate_noise` does, with columns that need not stand whole.

    Parameters
    ----------
    record : Record
    residual : ndarray, shape (n,)
    columns : Blocked, shape (n, p)
    own : bool
    wary : bool
    own_columns : sequence of int
        Columns of which each run has an unknown of its own, where not all are.
    """
    data = _Contrasts(record, residual, columns, own=own, own_columns=own_columns)
    scale = data.scale
    step_s, count = _usual_step_s(record)
    spans = [float(np.ptp(record.time_s[r])) for r in record.run_slices]
    if scale == 0.0 or count < 10:
        return _white_only(data)

    def evaluate(log_ratio: float, log_tau: float) -> tuple[float, float]:
        """Return the restricted log-likelihood and the white sigma that goes with it."""
        shape = NoiseModel(white=1.0, drift=np.exp(log_ratio), drift_tau_s=np.exp(log_tau))
        return data.restricted(shape)

    bounds = (
        (np.log(0.02), np.log(50.0)),
        (np.log(3.0 * step_s), np.log(3.0 * max(max(spans), 30.0))),
    )
    none, _ = data.restricted(NoiseModel(white=1.0))
    best = _maximise(evaluate, bounds)
    if best[0] <= none + 1e-3 and not wary:
        return _white_only(data)
    drifting, evidence = _support(evaluate, best[1], bounds)
    # Drift or none: equal odds beforehand, moved by how much better drift of any size and
    # correlation time within the bounds explains the data on average.
    odds = float(np.exp(min(evidence - none, 50.0)))
    share = odds / (1.0 + odds)
    white_alone = _white_only(data).noise
    support = [(share * w, _model(at, s * scale)) for w, at, s in drifting]
    if share < 0.99:
        support.append((1.0 - share, white_alone))
    _, white = evaluate(*best[1])
    noise = _model(best[1], white * scale) if share > 0.5 else white_alone
    return NoiseFit(noise=noise, support=tuple(support))


def _model(at: tuple[float, float], white: float) -> NoiseModel:
    return NoiseModel(
        white=white, drift=white * float(np.exp(at[0])), drift_tau_s=float(np.exp(at[1]))
    )


def _white_only(data: "_Contrasts") -> NoiseFit:
    _, sigma = data.restricted(NoiseModel(white=1.0))
    noise = NoiseModel(white=max(sigma * data.scale, np.finfo(float).tiny))
    return NoiseFit(noise=noise, support=((1.0, noise),))


def _usual_step_s(record: Record) -> tuple[float, int]:
    """Return the median of the times between readings, and how many there are."""
    steps = np.concatenate([np.diff(record.time_s[r]) for r in record.run_slices])
    return (float(np.median(steps)) if steps.size else 0.0), steps.size


class _Contrasts:
    """Columns and residual, of unit length each, whose whitened triangle the likelihood needs."""

    def __init__(
        self,
        record: Record,
        residual: FloatArray,
        columns: Blocked,
        *,
        own: bool,
        own_columns: Sequence[int] = (),
    ) -> None:
        self.record, self.residual, self.columns = record, residual, columns
        self.width = columns.shape[1] + 1
        runs = record.run_slices
        self.own_columns = list(own_columns) if len(runs) > 1 else []
        self.others = [k for k in range(self.width) if k not in self.own_columns]
        apart = own or bool(self.own_columns)
        self.groups = runs if apart else (slice(0, len(record)),)
        unknowns = self.width - 1
        if self.own_columns:
            unknowns += (len(self.groups) - 1) * len(self.own_columns)
        elif own:
            unknowns *= len(self.groups)
        self.dof = max(len(record) - unknowns, 1)
        self.norms = np.ones(self.width)
        squares = np.zeros(self.width)
        for _, joint in self._joint():
            squares += np.sum(joint**2, axis=0)
        norms = np.sqrt(squares)
        self.scale = float(norms[-1])
        self.norms = np.where(norms > 0, norms, 1.0)

    def restricted(self, shape: NoiseModel) -> tuple[float, float]:
        """Return the restricted log-likelihood, profiled over the white sigma, and that sigma."""
        if self.own_columns:
            rest2, log_seen, log_det = self._apart(shape)
        else:
            rest2, log_seen, log_det = self._together(shape)
        sigma2 = max(rest2 / self.dof, np.finfo(float).tiny)
        return -0.5 * (log_det + self.dof * np.log(sigma2)) - log_seen, float(np.sqrt(sigma2))

    def _apart(self, shape: NoiseModel) -> tuple[float, float, float]:
        """Return what `restricted` needs with some columns of each run's own: they go first."""
        left, log_seen = np.zeros((len(self.others),) * 2), 0.0
        mine = len(self.own_columns)
        order = [*self.own_columns, *self.others]
        grams, log_det = self._grams(shape)
        for gram in grams:
            root = _root(gram[np.ix_(order, order)])
            log_seen += _log_of_seen(np.diag(root)[:mine])
            rest = root[mine:, mine:]
            left += rest.T @ rest
        diagonal = np.diag(_root(left))
        return float(diagonal[-1]) ** 2, log_seen + _log_of_seen(diagonal[:-1]), log_det

    def _together(self, shape: NoiseModel) -> tuple[float, float, float]:
        rest2, log_seen = 0.0, 0.0
        diagonals, log_det = self._triangle_diagonals(shape)
        for diagonal in diagonals:
            rest, inner = diagonal[-1], diagonal[:-1]
            seen = inner[inner > 1e-9 * inner.max(initial=0.0)]
            rest2 += float(rest) ** 2
            log_seen += float(np.sum(np.log(seen)))
        return rest2, log_seen, log_det

    def _grams(self, shape: NoiseModel) -> tuple[list[FloatArray], float]:
        """Return the Gram matrix of each group's whitened columns, and ln det of all."""
        grams: list[FloatArray] = [np.zeros((self.width, self.width)) for _ in self.groups]
        whitening = shape.whitening(self.width)
        for number, white in self._whitened(whitening):
            grams[number] += white.T @ white
        return grams, whitening.log_det

    def _triangle_diagonals(self, shape: NoiseModel) -> tuple[list[FloatArray], float]:
        """Return the diagonals of R of the groups' QR factorisations, without signs, and ln det."""
        grams, log_det = self._grams(shape)
        try:  # the columns are of unit length and few: their Gram matrix keeps enough digits
            return [np.diag(linalg.cholesky(g, check_finite=False)) for g in grams], log_det
        except linalg.LinAlgError:
            triangles: list[FloatArray] = [np.zeros((0, self.width)) for _ in self.groups]
            for number, white in self._whitened(shape.whitening(self.width)):
                triangles[number] = triangle_of(white, triangles[number])
            return [np.abs(np.diag(t)) if len(t) else np.zeros(self.width) for t in triangles], (
                log_det
            )

    def _whitened(self, whitening: Whitening) -> Iterator[tuple[int, FloatArray]]:
        """Yield whitened columns of readings of one group, with the group; runs begin afresh."""
        for rows, joint in self._joint():
            white = whitening.whiten(self.record.view(rows), joint)
            for number, part in parts_of_runs(self.groups, rows):
                yield number, white[part.start - rows.start : part.stop - rows.start]

    def _joint(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the readings of each block with their columns and residual, of unit length."""
        for rows, block in self.columns.blocks():
            joint = np.empty((block.shape[0], self.width))
            np.divide(block, self.norms[:-1], out=joint[:, :-1])
            np.divide(self.residual[rows], self.norms[-1], out=joint[:, -1])
            yield rows, joint


def _root(gram: FloatArray) -> FloatArray:
    """Return the upper Cholesky factor; a column that the others hold gets hardly a length."""
    ridge = HARDLY**2 * np.eye(gram.shape[0])
    longest = float(np.diag(gram).max(initial=0.0))
    return np.asarray(linalg.cholesky(gram + ridge * longest, check_finite=False))


def _log_of_seen(diagonal: FloatArray) -> float:
    seen = diagonal[diagonal > 10.0 * HARDLY * diagonal.max(initial=0.0)]
    return float(np.sum(np.log(seen)))


Evaluate = Callable[[float, float], tuple[float, float]]
Bounds = tuple[tuple[float, float], tuple[float, float]]


def _maximise(evaluate: Evaluate, bounds: Bounds) -> tuple[float, tuple[float, float]]:
    """Return the best likelihood and where: a coarse grid, then a simplex from its best point."""
    ratios, taus = (np.linspace(*b, 6)[1:-1] for b in bounds)
    start = max(((r, t) for r in ratios for t in taus), key=lambda at: evaluate(*at)[0])
    found = optimize.minimize(
        lambda at: -evaluate(float(at[0]), float(at[1]))[0],
        start,
        method="Nelder-Mead",
        bounds=bounds,
        options={"xatol": 0.02, "fatol": 0.01, "maxfev": 120},
    )
    return -float(found.fun), (float(found.x[0]), float(found.x[1]))


def _support(
    evaluate: Evaluate, best: tuple[float, float], bounds: Bounds
) -> tuple[list[tuple[float, tuple[float, float], float]], float]:
    """Return the noise shapes the data allow on a grid around the best, with their shares.

    Along each axis the grid reaches out to where the log-likelihood has dropped by about 4.5
    (three sigma), or to the bound. The second result is the logarithm of the likelihood averaged
    over all shapes within the bounds.
    """
    top = evaluate(*best)[0]

    def reach(axis: int, sign: int) -> float:
        """Return how far the likelihood stays within 4.5 of its top along an axis."""
        edge = bounds[axis][sign > 0]
        step = 0.25
        at = best[axis]
        while abs(at - edge) > 1e-9 and step < 16:
            tried = max(min(best[axis] + sign * step, bounds[axis][1]), bounds[axis][0])
            point = (tried, best[1]) if axis == 0 else (best[0], tried)
            at = tried
            if top - evaluate(*point)[0] > 4.5:
                break
            step *= 1.6
        return at

    axes = [np.linspace(reach(a, -1), reach(a, +1), 7) for a in (0, 1)]
    points = [(float(r), float(t)) for r in axes[0] for t in axes[1]]
    values = [evaluate(*p) for p in points]
    highest = max(v[0] for v in values)
    shares = np.exp(np.array([v[0] for v in values]) - highest)
    cell = float(np.prod([np.ptp(a) / a.size for a in axes]))
    whole = float(np.prod([hi - lo for lo, hi in bounds]))
    evidence = highest + float(np.log(max(shares.sum() * cell / whole, 1e-300)))
    shares /= shares.sum()
    kept = [(float(w), p, v[1]) for w, p, v in zip(shares, points, values, strict=True) if w > 1e-3]
    return kept, evidence
