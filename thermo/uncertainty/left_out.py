"""Whether the residual still follows something: what a fit's own numbers tell of what it lacks.

Score tests (Rao 1948): an effect that is not in the model is projected on what the model leaves;
its size and sigma follow without a second fit. The noise is the one estimated from the same
residual, which a missing effect makes too large: what stands out all the same is there.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre

from errormodel.arrays import FloatArray
from errormodel.model import ErrorModel
from thermo.library.terms import MAX_ORDER, STATIC_NAMES, term
from thermo.recording.channel import Channel
from thermo.selection.residuals import rms
from thermo.uncertainty.linearised import Linearised

SIGMAS = 5.0  # of some twenty effects looked for: one false alarm in 100 000 fits of normal noise
WORTH = 0.3  # of the white noise: a smaller effect is no matter for a reading
MORE_THAN_NOISE = 1.3  # of the noise stated: no complete model left that much of 418 fits
GROSS_G = 5e-3  # misalignments of 50 mrad and third orders of 1000 µg/g³ leave less with a model
HIGHEST = 8
LEAST_LEFT = 1e-5  # of an effect's square that the model does not hold; less is rounding or alias
ALIKE = 0.8  # of the sigmas of the first: which of them it is, the residual does not tell
LOOP_WIDTH_C = 10.0


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


def left_out(line: Linearised, channel: Channel) -> tuple[LeftOut, ...]:
    """Return what the residual follows, the most significant first."""
    found: list[LeftOut] = []
    for name, words, effect in _effects(line, channel):  # one at a time: a recording may be long
        column = line.left(effect[:, None])[:, 0]
        length2 = float(column @ column)
        if not length2 > LEAST_LEFT * float(effect @ effect):
            continue  # the model has it, or the readings cannot tell it from what it has
        amount = float(column @ line.residual) / length2
        sigma = float(np.sqrt(line.variance(column[:, None])[0, 0])) / length2
        size = abs(amount) * float(np.sqrt(length2 / column.size))
        if abs(amount) > SIGMAS * sigma and size > WORTH * line.noise.white:
            told = words.format(amount=amount)
            sigmas = abs(amount) / sigma
            found.append(LeftOut(name=name, words=told, rms_ug=1e6 * size, sigmas=sigmas))
    return tuple(sorted(found, key=lambda one: -one.sigmas))


def _effects(line: Linearised, channel: Channel) -> Iterator[tuple[str, str, FloatArray]]:
    """Yield effects that may be missing: name, words, and their column in the output."""
    record, model = line.record, line.fit.model
    held = set(model.names)
    x = record["x_c"]
    ends = (float(x.min()), float(x.max()))
    if ends[1] > ends[0]:
        yield from _orders(x, ends, channel, held)
        rate = record["rate_c_per_min"]
        lag = "the rate of temperature times the slope over temperature (a lag of {amount:.3g} s)"
        yield "thermal_lag", lag, -line.by_temperature() * rate / 60.0
        yield "temperature_rate_bias", "the rate of temperature", rate
        values = {"bias_hysteresis": 1.0, "bias_hysteresis_width": LOOP_WIDTH_C}
        loop = ErrorModel((term("bias_hysteresis"),))
        direction = loop.simulate(record.with_signals(a_i_g=np.zeros(len(record))), values)
        yield "bias_hysteresis", "the direction of the temperature", direction
        if channel.has_input:
            yield (
                "temperature_rate_scale",
                "the rate of temperature times the input",
                (rate * record["a_i_g"]),
            )
    yield "bias_drift", "the time within a run ({amount:.1e} g/h)", record.time_s / 3600.0
    if channel.has_input:
        for name in STATIC_NAMES:
            if name not in held:
                alone = ErrorModel((term(name),))
                column = alone.simulate(record, {name: 1.0}) - record["a_i_g"]
                if np.any(column):
                    yield name, f"the input as {name} does", column


def _orders(
    x: FloatArray, ends: tuple[float, float], channel: Channel, held: set[str]
) -> Iterator[tuple[str, str, FloatArray]]:
    for order in range(1, HIGHEST + 1):
        shape = np.asarray(Legendre.basis(order, domain=list(ends))(x))
        high = order > MAX_ORDER
        name = "_above_4" if high else f"_t{order}"
        if f"k0{name}" not in held:
            yield f"k0{name}", f"the temperature to the power {order}", shape
        if channel.has_input and f"k1{name}" not in held:
            times = f"the temperature to the power {order} times the input"
            yield f"k1{name}", times, shape * channel.record["a_i_g"]


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


def noise_sentences(line: Linearised, channel: Channel) -> Iterator[str]:
    """Tell where the residual is no noise of the kind that the sigmas assume."""
    noise = line.noise
    left, stated = rms(line.residual), float(np.hypot(noise.white, noise.drift))
    if left > MORE_THAN_NOISE * stated:
        yield (
            f"the residual is {left / stated:.2g} times the noise that each run shows in itself "
            f"({1e6 * left:.3g} µg against {1e6 * stated:.3g} µg): the runs differ, or something "
            "that lasts a run is missing"
        )
    if channel.has_input and left > GROSS_G:
        yield (
            f"the residual is {1e3 * left:.3g} mg: no quartz-flexure accelerometer errs by so much "
            "once fitted; look for positions that are not what is recorded, a head still moving "
            "while it is read, or a term left out; nothing here is to be believed"
        )
    dwell = dwell_s(channel)
    if dwell and noise.drift > noise.white and noise.drift_tau_s < 2.0 * dwell:
        yield (
            f"{1e6 * noise.drift:.3g} µg of the residual change within {noise.drift_tau_s:.0f} s, "
            f"about as often as the position (every {dwell:.0f} s): that is no drift, but "
            "something that follows position or temperature: a lag, a head that moves or errs, a "
            "term left out, or an output coarser than its noise"
        )
    spans = [float(np.ptp(line.record.time_s[r])) for r in line.record.run_slices]
    if noise.drift > noise.white and noise.drift_tau_s > 2.0 * max(spans):
        yield (
            f"the bias drifts for longer than a run lasts ({noise.drift_tau_s / 3600:.2g} h): "
            "where temperature and time go together, K0 over temperature holds part of it"
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
        "sigma): the model lacks something, and its sigmas do not allow for that; accelbench "
        "discrepancy thermal looks for it"
    )
