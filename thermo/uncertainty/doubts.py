"""Doubts about a fit beside its estimates and sigmas: extrapolation, gaps, what is left."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.fit import ModelFit
from errormodel.model import ErrorModel
from thermo.library import STATIC_NAMES, term, thermal_library
from thermo.recording.channel import Channel
from thermo.selection.support import support_of, thermistor_noise_c
from thermo.uncertainty.by_position import ByPosition, by_position
from thermo.uncertainty.considered import (
    output_step,
    step_moves,
    temperature_noise_moves,
    thermometer_moves,
    with_moves,
)
from thermo.uncertainty.left_out import LeftOut, left_out, noise_sentences
from thermo.uncertainty.linearised import LinearisedFit, shifted
from thermo.uncertainty.loop_sigma import loop_sigma_ug
from thermo.uncertainty.not_shown import NotShown, holders, not_shown
from thermo.uncertainty.run_differences import OddRun, odd_run
from thermo.uncertainty.unseen_orders import Unseen, unseen_orders

# Orders above the second are seldom large, and stand in several.
MAY_BE_HELD = (*STATIC_NAMES, "k1", "k1_t1", "k1_t2")
MATTERS = 0.5  # of a sigma: what noise in the temperature moves is worth a word


@dataclass(frozen=True, slots=True, kw_only=True)
class Inside:
    """The coefficients at a temperature within the readings; values and sigmas by name."""

    t_ref_c: float
    values: dict[str, float]
    sigmas: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubts:
    """Doubts about one fit.

    Attributes
    ----------
    inside : Inside or None
        Where the reference temperature lies outside the readings.
    unseen : tuple of Unseen
        Orders that are not in the model; the covariance counts them.
    odd_run : OddRun or None
    left_out : tuple of LeftOut
        What the residual still follows.
    not_shown : tuple of NotShown
        Effects that these runs cannot tell from coefficients, whatever the residual.
    by_position : ByPosition or None
        How the residual follows the position.
    noise_sentences : tuple of str
    loop_sigma_ug : float or None
        Of heating minus cooling.
    thermistor_noise_c, output_step_ug : float
        Noise of a temperature, 1 sigma; step of the output, 0 where it shows none.
    temperature_noise_counts, output_step_counts : bool
        Whether the covariance is wider for it, by enough to be told.
    one_way : tuple of (str, float, float)
        With one direction of temperature only: what an effect of an ordinary size would do to K0,
        µg, and K1, ppm.
    holders : dict of str to tuple of str
        By a coefficient that the readings cannot give: those that hold it instead.
    """

    inside: Inside | None
    unseen: tuple[Unseen, ...]
    odd_run: OddRun | None
    left_out: tuple[LeftOut, ...]
    not_shown: tuple[NotShown, ...]
    by_position: ByPosition | None
    noise_sentences: tuple[str, ...]
    loop_sigma_ug: float | None
    thermistor_noise_c: float
    output_step_ug: float
    temperature_noise_counts: bool
    output_step_counts: bool
    one_way: tuple[tuple[str, float, float], ...]
    holders: dict[str, tuple[str, ...]]


def doubts_of(
    line: LinearisedFit,
    channel: Channel,
    t_ref_c: float,
    lost: Sequence[str] | None = None,
    by_angle: FloatArray | None = None,
) -> tuple[Doubts, ModelFit]:
    """Return what is to be doubted of a fit, and the fit with a covariance that counts it.

    Parameters
    ----------
    line : LinearisedFit
    channel : Channel
        What was fitted.
    t_ref_c : float
    lost : sequence of str, optional
        Coefficients that the readings cannot give; None when the user gave the terms.
    by_angle : ndarray, shape (n,), optional
        What the head's stated accuracy does to each reading.
    """
    noise_c = thermistor_noise_c(channel)
    step = output_step(np.asarray(channel.record.output))
    wobble = temperature_noise_moves(line, noise_c)
    stairs = step_moves(line, step)
    known = thermometer_moves(line, channel.temp_sigma_c, channel.temp_gain_ppm, t_ref_c)
    fit = with_moves(line.fit, np.hstack([wobble, stairs, known]))
    support = support_of(channel)
    low, high = support.temp_c[0][0], support.temp_c[-1][1]
    outside = not low <= t_ref_c <= high
    unseen = unseen_orders(line, channel, chosen=lost is not None, outside=outside)
    inside = _inside(fit, t_ref_c, low, high) if outside else None
    whole = with_moves(fit, np.array([u.among(fit.names) for u in unseen]).T) if unseen else fit
    follows = left_out(line, channel)
    loop_sigma = loop_sigma_ug(line, channel)
    return Doubts(
        inside=inside,
        unseen=unseen,
        odd_run=odd_run(line, channel.run_ids),
        left_out=follows,
        not_shown=not_shown(line, channel, follows),
        by_position=by_position(line, channel, by_angle),
        noise_sentences=tuple(noise_sentences(line, channel)),
        loop_sigma_ug=loop_sigma,
        thermistor_noise_c=noise_c,
        output_step_ug=1e6 * step,
        temperature_noise_counts=wobble.shape[1] > 0
        and bool(np.any(np.abs(wobble[:, 0]) > MATTERS * line.fit.sigmas)),
        output_step_counts=stairs.shape[1] > 0,
        one_way=tuple(_one_way(line, channel)) if loop_sigma is None else (),
        holders={name: _holders(line, name) for name in lost or () if name in MAY_BE_HELD},
    ), whole


def _inside(fit: ModelFit, t_ref_c: float, low: float, high: float) -> Inside:
    middle = round(0.5 * (low + high), 1)
    middle = middle if low <= middle <= high else 0.5 * (low + high)
    values, cov = shifted(fit, middle - t_ref_c)
    return Inside(
        t_ref_c=middle,
        values=dict(zip(fit.names, values.tolist(), strict=True)),
        sigmas=dict(zip(fit.names, np.sqrt(np.diag(cov)).tolist(), strict=True)),
    )


def _holders(line: LinearisedFit, name: str) -> tuple[str, ...]:
    """Return the coefficients that take up one that is not in the model."""
    a_i, x = line.record["a_i_g"], line.record["x_c"]
    if name in STATIC_NAMES:
        column = ErrorModel((term(name),)).simulate(line.record, {name: 1.0}) - a_i
    else:
        column = a_i * x ** thermal_library().parameters[name].order
    return holders(line, column)


LAG_S, LOOP_UG, DRIFT_UG_H = 120.0, 20.0, 10.0


def _one_way(line: LinearisedFit, channel: Channel) -> Iterator[tuple[str, float, float]]:
    """Yield effects of an ordinary size with how far they would move K0 and K1, µg and ppm."""
    moving = channel.direction != 0
    if not np.any(moving):
        return
    rate = channel.record["rate_c_per_min"] / 60.0
    effects = {
        f"a thermal lag of {LAG_S:g} s": -line.by_temperature() * rate * LAG_S,
        f"a loop of ±{LOOP_UG:g} µg": 1e-6 * LOOP_UG * channel.direction.astype(float),
        f"a drift of {DRIFT_UG_H:g} µg/h": 1e-6 * DRIFT_UG_H * channel.record.time_s / 3600.0,
    }
    names = line.fit.names
    for words, effect in effects.items():
        moved = line.moved(effect[:, None])[:, 0]
        k0, k1 = (1e6 * abs(float(moved[names.index(n)])) if n in names else 0.0 for n in
                  ("k0", "k1"))  # fmt: skip
        yield words, k0, k1
