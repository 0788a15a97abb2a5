"""Tests of the residual for factors that it still follows, from a fit's own numbers.

Score tests (Rao 1948): an effect that is not in the model is projected on what the model leaves;
its size and sigma follow without a second fit. The noise is the one estimated from the same
residual, which a missing effect makes too large: what stands out all the same is there.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from errormodel.arrays import rms
from thermo.recording.channel import Channel
from thermo.uncertainty.linearised import LinearisedFit, whole_effect
from thermo.uncertainty.missing_effects import Missing, missing_effects

SIGMAS = 5.0  # of some thirty effects looked for: one false alarm in 100 000 fits of normal noise
WORTH = 0.3  # of the white noise: a smaller effect is no matter for a reading
MORE_THAN_NOISE = 1.3  # of the noise stated: no complete model left that much of 418 fits
GROSS_G = 5e-3  # misalignments of 50 mrad and third orders of 1000 µg/g³ leave less with a model
LEAST_LEFT = 1e-5  # of an effect's square that the model does not hold; less is rounding or alias
ALIKE = 0.8  # of the sigmas of the first: which of them it is, the residual does not tell


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """Something that the residual follows.

    Attributes
    ----------
    name : str
    words : str
        What it follows, with the size where it has one.
    rms_ug : float
        Of the part that the model does not hold.
    sigmas : float
    """

    name: str
    words: str
    rms_ug: float
    sigmas: float


def left_out(line: LinearisedFit, channel: Channel) -> tuple[LeftOut, ...]:
    """Return what the residual follows, the most significant first."""
    # map holds no effect while the next one is made: a recording may be long
    found = [one for one in map(partial(_told, line), missing_effects(line, channel)) if one]
    return tuple(sorted(found, key=lambda one: -one.sigmas))


def _told(line: LinearisedFit, effect: Missing) -> LeftOut | None:
    """Return an effect that the residual follows; None where it does not."""
    sums = line.sums(line.left(whole_effect(effect.column)))
    length2 = float(sums.gram[0, 0])
    if not length2 > LEAST_LEFT * float(effect.column @ effect.column):
        return None  # the model has it, or the readings cannot tell it from what it has
    amount = float(sums.along[0]) / length2
    sigma = float(np.sqrt(sums.cov[0, 0])) / length2
    size = abs(amount) * float(np.sqrt(length2 / effect.column.size))
    if not (abs(amount) > SIGMAS * sigma and size > WORTH * line.noise.white):
        return None
    told, sigmas = effect.follows.format(amount=amount), abs(amount) / sigma
    return LeftOut(name=effect.name, words=told, rms_ug=1e6 * size, sigmas=sigmas)


def dwell_s(channel: Channel) -> float | None:
    """Return how long a position is held, s; None where positions do not change or are unknown."""
    position, record = channel.position_deg, channel.record
    if np.all(np.isnan(position)):
        position = record["a_i_g"]
    edges = np.flatnonzero((np.diff(position) != 0) | (np.diff(record.run) != 0)) + 1
    spans = [
        float(record.time_s[part[-1]] - record.time_s[part[0]])
        for part in np.split(np.arange(len(record)), edges)
        if part.size > 1
    ]
    if len(edges) < 4:
        return None
    steps = np.diff(record.time_s)[np.diff(record.run) == 0]
    return (float(np.median(spans)) if spans else 0.0) + float(np.median(steps))


def noise_sentences(line: LinearisedFit, channel: Channel) -> Iterator[str]:
    """Tell where the residual is no noise of the kind that the sigmas assume."""
    noise = line.noise
    left, stated = rms(line.residual), float(np.hypot(noise.white, noise.drift))
    if left > MORE_THAN_NOISE * stated:
        yield (
            f"the residual is {left / stated:.2g} times the noise within the runs "
            f"({1e6 * left:.3g} µg against {1e6 * stated:.3g} µg): the runs differ, or an effect "
            f"that is constant within a run is missing"
        )
    if channel.has_input and left > GROSS_G:
        yield (
            f"the residual is {1e3 * left:.3g} mg: too large for a fitted quartz-flexure "
            f"accelerometer; check for wrong positions, a head that moves during the readings, "
            f"or a missing term; do not use these results"
        )
    dwell = dwell_s(channel)
    if dwell and noise.drift > noise.white and noise.drift_tau_s < 2.0 * dwell:
        yield (
            f"{1e6 * noise.drift:.3g} µg of the residual change within {noise.drift_tau_s:.0f} s, "
            f"about as often as the position (every {dwell:.0f} s): this is not drift but an "
            f"effect of position or temperature: a lag, a head that moves or has an error, a "
            f"missing term, or an output coarser than its noise"
        )
    spans = [float(np.ptp(line.record.time_s[r])) for r in line.record.run_slices]
    if noise.drift > noise.white and noise.drift_tau_s > 2.0 * max(spans):
        yield (
            f"the correlation time of the bias drift is longer than a run "
            f"({noise.drift_tau_s / 3600:.2g} h): where temperature and time change together, K0 "
            f"over temperature absorbs part of it"
        )


def left_out_sentence(found: tuple[LeftOut, ...]) -> str:
    """Return what the residual follows as a sentence; empty when nothing."""
    if not found:
        return ""
    first = found[0]
    alike = [one.words for one in found if one.sigmas > ALIKE * first.sigmas]
    which = ", or ".join(list(dict.fromkeys(alike))[:3])
    return (
        f"the residual still follows {which} ({first.rms_ug:.3g} µg rms, {first.sigmas:.2g} "
        "sigma): the model lacks an effect, and the sigmas do not include it; accelbench "
        "discrepancy thermal searches for it"
    )
