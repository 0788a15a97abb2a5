"""Gains of chi-square: how much each candidate effect would explain under a noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Candidate, Factor, Problem, Signature, Theta
from errormodel.linear import independent
from errormodel.noise.model import NoiseModel
from errormodel.noise.whitening import Whitener

# Share of the length of a column, after projecting out the others, that counts as zero.
NOTHING = 2e-3
# A whitened column shorter than this is a rounding error of zero.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Point:
    """A candidate at given nonlinear parameters, whitened, the baseline projected out.

    `basis` spans what it adds; `whole` replaces the baseline's span when the effect changes it,
    with `offset` then subtracted from the data first.
    """

    basis: FloatArray
    whole: FloatArray | None = None
    offset: FloatArray | None = None


class View:
    """A problem under one noise: everything whitened by it, in units of its white sigma."""

    def __init__(self, problem: Problem, noise: NoiseModel) -> None:
        self.problem = problem
        self.noise = noise
        self.whitener: Whitener = noise.whitener(problem.times)
        self.base = independent(self.white(problem.base))
        self.data = self.white(problem.residual)

    def white(self, columns: FloatArray) -> FloatArray:
        """Return columns whitened."""
        return self.whitener.whiten(columns) / self.noise.white

    def beside_base(self, white: FloatArray) -> FloatArray:
        """Return whitened columns with the baseline projected out."""
        return white - self.base @ (self.base.T @ white)

    def points(self, signatures: Sequence[Signature]) -> list[Point]:
        """Return signatures prepared for `gain`; all are whitened in one pass."""
        if not signatures:
            return []
        widths = [s.columns.shape[1] for s in signatures]
        stacked = self.white(np.hstack([s.columns for s in signatures]))
        beside = self.beside_base(stacked)
        lengths, left = np.linalg.norm(stacked, axis=0), np.linalg.norm(beside, axis=0)
        unit = beside / np.where(left > 0, left, 1.0)
        shown = (left > NOTHING * lengths) & (lengths > ROUNDING)
        ends = np.cumsum(widths)
        made: list[Point] = []
        for end, width, s in zip(ends, widths, signatures, strict=True):
            own = slice(end - width, end)
            if s.base is not None or s.offset is not None:
                made.append(self._replaced(s))
            elif width == 1:
                made.append(Point(basis=unit[:, own] if shown[end - 1] else unit[:, :0]))
            else:
                made.append(Point(basis=independent(beside[:, own][:, shown[own]], 1e-5)))
        return made

    def _replaced(self, s: Signature) -> Point:
        base = self.problem.base if s.base is None else s.base
        whole = independent(self.white(np.hstack([base, s.columns])))
        offset = None if s.offset is None else self.white(s.offset)
        return Point(basis=whole[:, :0], whole=whole, offset=offset)

    def gains(self, points: Sequence[Point], data: FloatArray) -> FloatArray:
        """Return the chi-square that each point explains in addition to the baseline.

        Parameters
        ----------
        points : sequence of Point
        data : ndarray, shape (n, D)
            Whitened residuals.

        Returns
        -------
        ndarray, shape (number of points, D)
        """
        inside = np.sum((self.base.T @ data) ** 2, axis=0)
        plain = [p for p in points if p.whole is None]
        out = np.zeros((len(points), data.shape[1]))
        if plain:
            squares = (np.hstack([p.basis for p in plain]).T @ data) ** 2
            widths = np.array([p.basis.shape[1] for p in plain])
            running = np.vstack([np.zeros(data.shape[1]), np.cumsum(squares, axis=0)])
            ends = np.cumsum(widths)
            rows = [k for k, p in enumerate(points) if p.whole is None]
            out[rows] = running[ends] - running[ends - widths]
        for k, p in enumerate(points):
            if p.whole is not None:
                out[k] = np.sum((p.whole.T @ data) ** 2, axis=0) - inside
                if p.offset is not None:
                    rest = p.offset - p.whole @ (p.whole.T @ p.offset)
                    out[k] += 2.0 * (rest @ data) - rest @ p.offset
        return out

    def strength(self, signature: Signature) -> float:
        """Return the length of a signature's offset or first column, the baseline projected out."""
        column = signature.offset if signature.offset is not None else signature.columns[:, 0]
        white = self.white(column)
        if signature.base is not None:
            base = independent(self.white(signature.base))
            return float(np.linalg.norm(white - base @ (base.T @ white)))
        return float(np.linalg.norm(self.beside_base(white)))

    def factor_gains(self, factor: Factor, data: FloatArray) -> FloatArray:
        """Return the chi-square that a factor explains in addition to the baseline, shape (D,)."""
        points = self.points([Signature(columns=group) for group in factor.groups])
        return self.gains(points, data).max(axis=0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Found:
    """The best fit of a candidate: nonlinear parameters and gain of chi-square.

    `grid_gain` is that of the best point of the grid, which the null draws are compared with.
    """

    candidate: Candidate
    theta: Theta
    gain: float
    grid_gain: float


class Prepared:
    """The prepared grids of all candidates under one noise."""

    def __init__(self, view: View, candidates: Sequence[Candidate]) -> None:
        self.view = view
        self.candidates = tuple(candidates)
        signatures = [c.grid_signatures for c in candidates]
        points = view.points([s for many in signatures for s in many])
        self.points: list[list[Point]] = []
        for many in signatures:
            self.points.append(points[: len(many)])
            points = points[len(many) :]

    def null_gains(self, data: FloatArray) -> FloatArray:
        """Return each candidate's best gain over its grid, shape (number of candidates, D).

        Never negative, because an effect without a free coefficient may also be absent.
        """
        gains = self.view.gains([p for many in self.points for p in many], data)
        ends = np.cumsum([len(many) for many in self.points])
        parts = np.split(gains, ends[:-1]) if ends.size else []
        best = [np.maximum(part.max(axis=0), 0.0) for part in parts]
        return np.array(best).reshape(-1, data.shape[1])

    def scan(self, *, refine: bool = True) -> list[Found]:
        """Return every candidate at its best for the measured residual."""
        data = self.view.data[:, None]
        found: list[Found] = []
        for candidate, points in zip(self.candidates, self.points, strict=True):
            gains = self.view.gains(points, data)[:, 0]
            k = int(np.argmax(gains))
            best = Found(
                candidate=candidate,
                theta=candidate.grid[k],
                gain=float(gains[k]),
                grid_gain=float(gains[k]),
            )
            if refine and candidate.finer is not None:
                best = _finer(self.view, best, candidate.finer(best.theta))
            elif refine and candidate.bounds:
                best = _refined(self.view, best)
            found.append(best)
        return found


def _finer(view: View, best: Found, thetas: Sequence[Theta]) -> Found:
    """Try points about the grid's best, all at once."""
    if not thetas:
        return best
    points = view.points([best.candidate.signature(theta) for theta in thetas])
    gains = view.gains(points, view.data[:, None])[:, 0]
    k = int(np.argmax(gains))
    if gains[k] <= best.gain:
        return best
    gain = float(gains[k])
    return Found(candidate=best.candidate, theta=thetas[k], gain=gain, grid_gain=best.grid_gain)


def _refined(view: View, best: Found) -> Found:
    """Move the nonlinear parameters from the grid's best to where the gain is largest."""
    candidate, data = best.candidate, view.data[:, None]

    def loss(theta: Theta) -> float:
        points = view.points([candidate.signature(theta)])
        return -float(view.gains(points, data)[0, 0])

    if len(candidate.bounds) == 1:
        values = sorted(t[0] for t in candidate.grid)
        k = values.index(best.theta[0])
        lo = values[k - 1] if k else candidate.bounds[0][0]
        hi = values[k + 1] if k + 1 < len(values) else candidate.bounds[0][1]
        if hi <= lo:
            return best
        scale = candidate.bounds[0][0] > 0.0  # of a place the logarithm has no meaning
        to, back = (np.log, np.exp) if scale else (float, float)
        found = optimize.minimize_scalar(
            lambda u: loss((float(back(u)),)),
            bounds=(to(lo), to(hi)),
            method="bounded",
            options={"xatol": 2e-3 * (1.0 if scale else hi - lo), "maxiter": 16},
        )
        theta, gain = (float(back(found.x)),), -float(found.fun)
    else:
        bounds = [(np.log(lo), np.log(hi)) for lo, hi in candidate.bounds]
        many = optimize.minimize(
            lambda u: loss(tuple(np.exp(u).tolist())),
            np.log(best.theta),
            method="Nelder-Mead",
            bounds=bounds,
            options={"xatol": 5e-3, "fatol": 0.02, "maxfev": 60},
        )
        theta, gain = tuple(np.exp(many.x).tolist()), -float(many.fun)
    if gain <= best.gain:
        return best
    return Found(candidate=candidate, theta=theta, gain=gain, grid_gain=best.grid_gain)
