"""Whether a residual follows the position: misfit that white noise would not leave.

At each position readings scatter about what the model gives. Where their means differ by more than
that scatter, or change with temperature otherwise at one position than at others, a position is not
what is recorded, the output saturates or its two directions have different gains, or a term of the
input is missing. A joint score test (Rao 1948): indicators of the positions, projected on what the
model leaves, against their covariance under the noise that is there.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from errormodel.arrays import FloatArray, IntArray
from thermo.recording.channel import Channel
from thermo.recording.runs import FORCES
from thermo.uncertainty.linearised import Linearised

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
    line: Linearised, channel: Channel, by_angle: FloatArray | None = None
) -> ByPosition | None:
    """Return how the residual follows the position; None where it does not.

    Parameters
    ----------
    line : Linearised
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
    half = 0.5 * float(np.ptp(x))
    tests = (_test(line, names, group, shape, by_angle) for shape in _shapes(x, half))
    return max((one for one in tests if one), key=lambda one: one.sigmas, default=None)


def _shapes(x: FloatArray, half: float) -> Iterator[FloatArray | None]:
    yield None
    if half > 0:
        yield (x - 0.5 * float(x.min() + x.max())) / half


def positions_of(channel: Channel) -> tuple[list[str], IntArray]:
    """Return the positions' names and which of them each reading was taken at, shape (n,)."""
    forces = np.column_stack([channel.record[n] for n in FORCES])
    keys = np.round(forces / SAME_INPUT_G).astype(np.int64)
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    if first.size > MANY:
        a_i = forces[:, 0]
        edges: FloatArray = np.linspace(float(a_i.min()), float(a_i.max()), MANY + 1)
        bins = np.digitize(a_i, edges[1:-1])
        present, group = np.unique(bins, return_inverse=True)
        middles: FloatArray = 0.5 * (edges[present] + edges[present + 1])
        return [f"{a:.2f} g along IA" for a in middles.tolist()], group.reshape(-1)
    at = channel.position_deg[first]
    return [
        f"{angle:g}°" if np.isfinite(angle) else "(" + ", ".join(f"{f:.3f}" for f in axis) + ") g"
        for angle, axis in zip(at.tolist(), forces[first].tolist(), strict=True)
    ], group


def _test(
    line: Linearised,
    names: list[str],
    group: IntArray,
    shape: FloatArray | None,
    by_angle: FloatArray | None,
) -> ByPosition | None:
    count = np.bincount(group, minlength=len(names))
    tested = np.flatnonzero(count >= LEAST)
    at = group[:, None] == tested  # a byte each: the readings may be many
    form = np.ones(1) if shape is None else shape
    left = np.empty(at.shape)
    for k in range(tested.size):  # one by one, for the same reason
        left[:, k] = line.left((form * at[:, k])[:, None])[:, 0]
    cov = line.variance(left)
    if by_angle is not None:
        errs = np.column_stack([left.T @ (by_angle * form * one) for one in at.T])
        cov = cov + errs @ errs.T
    along, gram = left.T @ line.residual, left.T @ left
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
    means = 1e6 * ((form * line.residual) @ at) / (np.broadcast_to(form**2, group.shape) @ at)
    worst = np.argsort(-np.abs(means))[:SHOWN]
    told = np.asarray(single > ALONE * chi2, dtype=np.bool_)
    alone: list[int] = tested[told].tolist()
    ends = 1.0 if shape is None else 2.0
    return ByPosition(
        over_temperature=shape is not None,
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
        which = f" ({' or '.join(found.alone)} alone would account for it)"
    if found.over_temperature:
        return (
            "the residual changes with temperature otherwise at one position than at others: "
            f"from cold to warm {told}{which}; {found.rms_ug:.3g} µg rms, {found.sigmas:.2g} "
            "sigma: that is no noise; an axis that tilts with temperature, or another term of the "
            "input that changes with it, is missing, and the sigmas do not allow for that"
        )
    return (
        f"the residual follows the position: {told}{which}; {found.rms_ug:.3g} µg rms, "
        f"{found.sigmas:.2g} sigma: that is no noise; a position is not what is recorded, the "
        "output saturates or differs in gain between + and −, or a term of the input is missing, "
        "and the sigmas of all coefficients do not allow for that"
    )
