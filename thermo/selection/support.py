"""Support of a model by readings: temperatures, gaps between them, rates and forces."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, sealed
from errormodel.record import Record
from errormodel.statistics.outliers import smallest_step
from errormodel.statistics.robust import robust_sigma
from thermo.recording.channel import Channel
from thermo.recording.labels import BoolArray
from thermo.recording.runs import FORCES
from thermo.recording.signals import RATE_WINDOW_S

# Five temperatures evenly spread carry the highest order there is, and leave gaps of a quarter of
# the range: what is wider, a polynomial bridges without a reading to hold it.
GAP_SHARE = 0.3
LEAST_GAP_C = 1.0
# Readings whose temperatures differ by no more than the thermistor's noise have one temperature.
NOISE_SPAN = 12.0  # of its sigma: the range of a soak of an hour
SOAK_C = 0.02
NEIGHBOURS = (-2, -1, 1, 2)
FORCE_MARGIN_G = 0.1  # a polynomial of the input is as good a little beyond the positions


@dataclass(frozen=True, slots=True, kw_only=True)
class Support:
    """Range that the fitted readings cover.

    Attributes
    ----------
    temp_c : tuple of (float, float)
        Intervals of temperature with readings, low to high.
    rate_c_per_min : pair of float
    force_g : mapping of str to pair of float
        Of each of `a_i_g`, `a_p_g`, `a_o_g`, where the input is known.
    """

    temp_c: tuple[tuple[float, float], ...]
    rate_c_per_min: tuple[float, float]
    force_g: Mapping[str, tuple[float, float]]

    @property
    def gaps_c(self) -> tuple[tuple[float, float], ...]:
        """Intervals between readings that are too wide to be bridged."""
        edges = zip(self.temp_c[:-1], self.temp_c[1:], strict=True)
        return tuple((before[1], after[0]) for before, after in edges)


def support_of(channel: Channel) -> Support:
    """Return what readings cover."""
    rate = channel.record["rate_c_per_min"]
    known = {n: channel.record[n] for n in FORCES} if channel.has_input else {}
    return Support(
        temp_c=temperature_intervals(channel.temp_c),
        rate_c_per_min=(float(rate.min()), float(rate.max())),
        force_g={n: (float(a.min()), float(a.max())) for n, a in known.items()},
    )


def temperature_intervals(temp_c: FloatArray) -> tuple[tuple[float, float], ...]:
    """Return the intervals of temperature with readings, cut where a gap is too wide."""
    levels = np.unique(temp_c)
    widest = max(GAP_SHARE * float(levels[-1] - levels[0]), LEAST_GAP_C)
    cuts = np.flatnonzero(np.diff(levels) > widest) + 1
    return tuple((float(part[0]), float(part[-1])) for part in np.split(levels, cuts))


def within(values: FloatArray, parts: tuple[tuple[float, float], ...]) -> BoolArray:
    """Tell which values lie in one of the intervals."""
    inside = np.zeros(values.shape, dtype=np.bool_)
    for low, high in parts:
        inside |= (values >= low) & (values <= high)
    return inside


def thermistor_noise_c(channel: Channel) -> float:
    """Return the noise of a single temperature, 1 sigma, °C.

    The scatter about a line over two minutes, or about a cubic through the neighbours where the
    temperature bends too much for a line (an approach to a soak, read once a minute); what the
    digits round off, at least.
    """
    record = channel.record
    steps = np.diff(record.time_s)[np.diff(record.run) == 0]
    if steps.size < 10:
        return 0.0
    step = float(np.median(steps))
    count = 1 + 2 * int(max(RATE_WINDOW_S / 2, 2.5 * step) / step)
    about_line = robust_sigma(record["x_c"] - record["x_slow_c"]) / np.sqrt(1.0 - 1.0 / count)
    rounded = smallest_step(channel.temp_c) / np.sqrt(12.0)
    return float(min(about_line, max(_about_cubics(record), rounded)))


def _about_cubics(record: Record) -> float:
    """Return the sigma of temperatures about cubics through two readings on either side, °C."""
    here = np.flatnonzero(record.run[4:] == record.run[:-4]) + 2
    if not here.size:
        return np.inf
    time_s, x = record.time_s, record["x_c"]
    off, variance = x[here].copy(), np.ones(here.size)
    for mine in NEIGHBOURS:
        weight = np.ones(here.size)
        for other in NEIGHBOURS:
            if other != mine:  # Lagrange's interpolation
                weight *= time_s[here] - time_s[here + other]
                weight /= time_s[here + mine] - time_s[here + other]
        off -= weight * x[here + mine]
        variance += weight**2
    return robust_sigma(off / np.sqrt(variance))


def settled(channel: Channel) -> FloatArray:
    """Return x_c with each soak at one temperature: the thermistor's noise is no temperature."""
    x = channel.record["x_c"]
    width = NOISE_SPAN * thermistor_noise_c(channel) + SOAK_C
    order = np.argsort(x, kind="stable")
    cuts = np.flatnonzero(np.diff(x[order]) > width) + 1
    out = x.copy()
    for rows in np.split(order, cuts):
        if float(np.ptp(x[rows])) <= width:
            out[rows] = float(x[rows].mean())
    return sealed(out)
