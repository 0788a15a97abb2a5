"""Two effects at once, for effects that partly cancel each other.

If two effects half cancel, a third effect may fit the residual better than either of them alone. A
search that adds one effect after another then begins with the third.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Candidate, Signature, columns_of
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search.choices import Choice

# Number of grid points tried for an effect with many points; a refit follows.
POINTS = 9


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    """An effect at one grid point, and the position of its basis among all bases."""

    choice: Choice
    at: slice


def best_pair(view: View, candidates: Sequence[Candidate]) -> tuple[Choice, Choice] | None:
    """Return the two effects that explain most together; first the one that explains more alone.

    An effect that changes an input is represented by its response at a grid point, with free size.

    Parameters
    ----------
    view : View
    candidates : sequence of Candidate

    Returns
    -------
    tuple of Choice, or None where there are no two
    """
    tried, basis = _bases(view, candidates)
    seen = basis.T @ view.data
    gram = basis.T @ basis
    best: tuple[float, _Tried, _Tried] | None = None
    for one, other in combinations(tried, 2):
        if one.choice.name == other.choice.name:
            continue
        rows = np.r_[one.at, other.at]
        inner = gram[np.ix_(rows, rows)] + 1e-9 * np.eye(rows.size)
        gain = float(seen[rows] @ np.linalg.solve(inner, seen[rows]))
        if best is None or gain > best[0]:
            best = gain, one, other
    if best is None:
        return None
    ordered = sorted(best[1:], key=lambda t: -float(seen[t.at] @ seen[t.at]))
    return ordered[0].choice, ordered[1].choice


def _bases(view: View, candidates: Sequence[Candidate]) -> tuple[list[_Tried], FloatArray]:
    """Return every effect at some points of its grid, with the orthonormal bases side by side."""
    choices: list[Choice] = []
    signatures: list[Signature] = []
    for candidate in candidates:
        every = max(1, round(len(candidate.grid) / POINTS))
        for theta, signature in list(zip(candidate.grid, candidate.grid_signatures, strict=True))[
            ::every
        ]:
            choices.append(Choice(candidate.name, theta))
            signatures.append(Signature(columns=columns_of(signature)))
    points = view.points(signatures)
    ends = np.cumsum([p.basis.shape[1] for p in points]).tolist()
    starts = [0, *ends[:-1]]
    tried = [
        _Tried(choice, slice(start, end))
        for choice, start, end in zip(choices, starts, ends, strict=True)
        if end > start
    ]
    return tried, np.hstack([np.zeros((view.data.size, 0)), *(p.basis for p in points)])
