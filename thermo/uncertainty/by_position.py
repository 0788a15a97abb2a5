"""Test of a residual for misfit by position, which white noise would not leave.

At each position readings scatter about what the model gives. Where their means differ by more than
that scatter, or change with temperature otherwise at one position than at others, a position is not
what is recorded, the output saturates or its two directions have different gains, or a term of the
input is missing. A joint score test (Rao 1948): indicators of the positions, projected on what the
model leaves, against their covariance under the noise that is there.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from errormodel.arrays import FloatArray, IntArray
from errormodel.blocks import block_slices
from thermo.recording.channel import Channel
from thermo.recording.runs import FORCES
from thermo.uncertainty.linearised import LinearisedFit

FALSE_ALARM = 6e-7  # of each of the two tests: 5 sigma of a single effect
# Of the white noise, rms: the coefficients of 1000 readings are then off by three of their sigmas.
WORTH = 0.1
SAME_INPUT_G = 1e-3  # 0.06°: forces nearer than that are one position
MANY = 24  # positions; where there are more, readings are taken together by a_i
LEAST = 5  # readings of a position that show its scatter
RANK = 1e-9
ALONE = 0.8  # of χ²: freeing this position alone would take so much of the misfit away
SHOWN = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ByPosition:
    """A residual that follows the position.

    Attributes
    ----------
    over_temperature : bool
        Whether it is its change with temperature that does.
    rms_ug : float
        Of the part that follows.
    sigmas : float
        As of one normal deviate that is as unlikely.
    positions : tuple of (str, float)
        The worst with their mean residual, µg; over temperature at the warm end less the cold.
    alone : tuple of str
        Positions of which each alone would account for it.
    """

    over_temperature: bool
    rms_ug: float
    sigmas: float
    positions: tuple[tuple[str, float], ...]
    alone: tuple[str, ...]


def by_position(
    line: LinearisedFit, channel: Channel, by_angle: FloatArray | None = None
) -> ByPosition | None:
    """Return how the residual follows the position; None where it does not.

    Parameters
    ----------
    line : LinearisedFit
        With its run effects.
    channel : Channel
        What was fitted.
    by_angle : ndarray, shape (n,), optional
        What the head's stated accuracy, 1 sigma, does to each reading: each position may be off
        by that.
    """
    if not (channel.has_input and line.noise.white > 0.0):
        return None
    names, group = positions_of(channel)
    if len(names) < 2:
        return None
    x = line.record["x_c"]
    low, high = float(x.min()), float(x.max())
    tests = (
        _test(line, names, group, over_temperature, by_angle)
        for over_temperature in ((False, True) if high > low else (False,))
    )
    return max((one for one in tests if one), key=lambda one: one.sigmas, default=None)


def positions_of(channel: Channel) -> tuple[list[str], NDArray[np.integer[Any]]]:
    """Return the positions' names and which of them each reading was taken at, shape (n,)."""
    forces = [channel.record[n] for n in FORCES]
    found = _few_positions(forces)
    if found is None:
        a_i = forces[0]
        edges: FloatArray = np.linspace(float(a_i.min()), float(a_i.max()), MANY + 1)
        bins = np.digitize(a_i, edges[1:-1])
        present, group = np.unique(bins, return_inverse=True)
        middles: FloatArray = 0.5 * (edges[present] + edges[present + 1])
        return [f"{a:.2f} g along IA" for a in middles.tolist()], group.reshape(-1)
    first, group = found
    at = channel.position_deg[first]
    return [
        f"{angle:g}°" if np.isfinite(angle) else "(" + ", ".join(f"{f:.3f}" for f in axis) + ") g"
        for angle, axis in zip(
            at.tolist(), np.column_stack([f[first] for f in forces]).tolist(), strict=True
        )
    ], group


def _few_positions(forces: list[FloatArray]) -> tuple[IntArray, NDArray[np.int8]] | None:
    """Return the first reading of each position and the position of each; None if many."""
    group = np.empty(forces[0].size, dtype=np.int8)
    known: dict[tuple[int, ...], tuple[int, int]] = {}  # number as it came, first reading
    for rows in block_slices(group.size):
        keys = np.column_stack([np.round(f[rows] / SAME_INPUT_G) for f in forces]).astype(np.int64)
        begins = np.flatnonzero(np.any(np.diff(keys, axis=0) != 0, axis=1)) + 1
        begins = np.concatenate([[0], begins])
        numbers: list[int] = []
        for begin, key in zip(begins.tolist(), keys[begins].tolist(), strict=True):
            numbers.append(known.setdefault(tuple(key), (len(known), rows.start + begin))[0])
            if len(known) > MANY:
                return None
        lengths = np.diff(np.append(begins, keys.shape[0]))
        group[rows] = np.repeat(np.array(numbers, dtype=np.int8), lengths)
    in_order = [known[key] for key in sorted(known)]
    place = np.argsort([number for number, _ in in_order]).astype(np.int8)
    return np.array([at for _, at in in_order]), place[group]


def _test(
    line: LinearisedFit,
    names: list[str],
    group: NDArray[np.integer[Any]],
    over_temperature: bool,
    by_angle: FloatArray | None,
) -> ByPosition | None:
    count = np.bincount(group, minlength=len(names))
    tested = np.flatnonzero(count >= LEAST)
    x = line.record["x_c"]
    middle, half = 0.5 * float(x.min() + x.max()), 0.5 * float(np.ptp(x))

    def own(rows: slice) -> FloatArray:
        """Return the indicators of the positions, or their temperatures from −1 to 1."""
        here = (group[rows, None] == tested).astype(float)
        return here * ((x[rows, None] - middle) / half) if over_temperature else here

    sums = line.sums(line.left(own), tested.size)
    along, gram, cov = sums.along, sums.gram, sums.cov
    if by_angle is not None:
        errs = np.zeros_like(gram)
        for rows, left in line.left(own):
            errs += left.T @ (by_angle[rows, None] * own(rows))
        cov = cov + errs @ errs.T
    values, vectors = np.linalg.eigh(gram)
    kept = vectors[:, values > RANK * float(count.max())]
    if not kept.shape[1]:
        return None
    part, spread = kept.T @ along, kept.T @ cov @ kept
    chi2 = float(part @ np.linalg.solve(spread, part))
    followed = float(part @ np.linalg.solve(kept.T @ gram @ kept, part))
    size = float(np.sqrt(followed / group.size))
    log_p = float(stats.chi2.logsf(chi2, kept.shape[1]))
    if log_p > np.log(FALSE_ALARM) or size < WORTH * line.noise.white:
        return None
    variance: FloatArray = np.maximum(np.diag(cov), float(np.finfo(float).tiny))
    single: FloatArray = np.square(along) / variance
    single[np.diag(gram) <= RANK * count.max()] = 0.0
    totals, squares = np.zeros(tested.size), np.zeros(tested.size)
    for rows in block_slices(group.size):
        here = own(rows)
        totals += here.T @ line.residual[rows]
        squares += np.sum(here**2, axis=0)
    means = 1e6 * totals / squares
    worst = np.argsort(-np.abs(means))[:SHOWN]
    told = np.asarray(single > ALONE * chi2, dtype=np.bool_)
    alone: list[int] = tested[told].tolist()
    ends = 2.0 if over_temperature else 1.0
    return ByPosition(
        over_temperature=over_temperature,
        rms_ug=1e6 * size,
        sigmas=_deviate(log_p, chi2),
        positions=tuple((names[tested[k]], ends * float(means[k])) for k in worst),
        alone=tuple(names[k] for k in alone),
    )


def _deviate(log_p: float, chi2: float) -> float:
    """Return the normal deviate that is as unlikely; far out it is the root of χ²."""
    if log_p <= -600.0:  # the probability is beyond what a float holds
        return float(np.sqrt(chi2))
    return -float(special.ndtri(0.5 * float(np.exp(log_p))))


def by_position_sentence(found: ByPosition) -> str:
    """Return a residual that follows the position as a sentence."""
    told = ", ".join(f"{name} {ug:+.3g} µg" for name, ug in found.positions)
    told = told.replace("-", "−")
    which = ""
    if 0 < len(found.alone) <= SHOWN:
        which = f" ({' or '.join(found.alone)} alone would explain it)"
    if found.over_temperature:
        return (
            "the residual changes with temperature differently at one position from others: from "
            f"cold to warm {told}{which}; {found.rms_ug:.3g} µg rms, {found.sigmas:.2g} "
            "sigma: this is not noise; an axis that tilts with temperature, or another input "
            "term that changes with temperature, is missing, and the sigmas do not include it"
        )
    return (
        f"the residual follows the position: {told}{which}; {found.rms_ug:.3g} µg rms, "
        f"{found.sigmas:.2g} sigma: this is not noise; a position differs from the recorded one, "
        f"the output saturates or has different gains for + and −, or an input term is missing, "
        f"and the sigmas of all coefficients do not include it"
    )
