"""The article's covariance analysis: its two tables, and the readings of its text they may have.

The article states its priors, its noise and its motion, but not everything a covariance needs:
whether the attitude is carried from cycle to cycle, what is known of the platform's base and of
the axis's azimuth, whether the mounting is the same in all cycles. A `Reading` says each of these;
`best_reading` finds the one under which all twelve published entries come out best.

References
----------
SINS calibration on a rig (control and navigation laboratory, Lomonosov Moscow State University),
section on the covariance analysis, tables 1 and 2.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray
from sinscal.filter.data import RigNoise
from sinscal.frames.earth import ARCMIN, ARCSEC, DEG_PER_H
from sinscal.library import BASIC, rig_library
from sinscal.library.angle import TIME_OFFSET
from sinscal.model.priors import make_prior
from sinscal.model.sensors import sensor_model
from sinscal.planning.covariance import LinearisedFilter, RigCovariance, linearise, solve
from sinscal.twin.programme import article_programme

Base = Literal["known", "same", "free"]

NOISE = RigNoise(gyro=0.1 * DEG_PER_H, accel=0.001, angle=15.0 * ARCSEC)
MOUNT_SIGMA_RAD = np.pi / 180.0
KNOWN_RAD = 1e-7  # as good as exactly
# key of the tables: group of unknowns, SI units in one of the key's
ENTRIES: Mapping[str, tuple[str, float]] = {
    "gyro_bias_deg_h": ("gyro_bias", DEG_PER_H),
    "gyro_scale": ("gyro_scale", 1.0),
    "gyro_misalignment_arcmin": ("gyro_misalignment", ARCMIN),
    "accel_bias_m_s2": ("accel_bias", 1.0),
    "accel_scale": ("accel_scale", 1.0),
    "accel_misalignment_arcmin": ("accel_misalignment", ARCMIN),
}
PUBLISHED_COARSE = dict(zip(ENTRIES, (0.01, 5.1e-7, 0.1, 9e-5, 1.36e-5, 0.1), strict=True))
PUBLISHED_PRECISE = dict(zip(ENTRIES, (0.003, 9.7e-8, 0.05, 7.7e-5, 1.36e-5, 0.05), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Interpretation of what the article leaves open; the defaults are the literal text.

    Attributes
    ----------
    accel_factor, gyro_factor : float
        Noise of accelerometers and gyros over what is stated.
    carried : bool
        Whether the gyros carry the attitude from cycle to cycle; else each begins anew.
    azimuth_arcmin : float, optional
        How well the rotation axis's azimuth is known; None: not at all.
    base : {"known", "same", "free"}
        The attitude of the platform at angle zero: known, one unknown for all cycles, or an
        unknown of each cycle. Precise mode only.
    remounted : bool
        Whether the mounting is another in each cycle. Precise mode only.
    """

    accel_factor: float = 1.0
    gyro_factor: float = 1.0
    carried: bool = False
    azimuth_arcmin: float | None = None
    base: Base = "free"
    remounted: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """The assumptions, in sentences."""
        accel = 1e3 * NOISE.accel * self.accel_factor
        gyro = NOISE.gyro * self.gyro_factor / DEG_PER_H
        bases = {
            "known": "The platform's attitude at angle zero is known (it gives north as well).",
            "same": "The platform's attitude at angle zero is one parameter for all cycles.",
            "free": "The platform's attitude at angle zero is a separate parameter in each cycle.",
        }
        return (
            f"Accelerometer noise {accel:g} mm/s² at 1 Hz, {_times(self.accel_factor)}.",
            f"Gyro noise {gyro:g} °/h at 1 Hz, {_times(self.gyro_factor)}.",
            "The gyros carry the attitude from cycle to cycle."
            if self.carried
            else "The attitude starts anew in each cycle.",
            "The azimuth of the rotation axis is estimated by the filter."
            if self.azimuth_arcmin is None
            else f"The azimuth of the rotation axis is known to {self.azimuth_arcmin:g} arcmin.",
            bases[self.base],
            "The mounting is a separate parameter in each cycle."
            if self.remounted
            else "The mounting (1°) is the same in all cycles; the clock offset (0.05 s) too.",
        )


def _times(factor: float) -> str:
    return "as stated" if factor == 1.0 else f"{factor:g} times what is stated"


LITERAL = Reading()
# Of `readings()` the one that `best_reading` finds; a test holds it to that.
BEST = Reading(accel_factor=4.0, gyro_factor=0.5, base="known")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One entry of a table: published, computed (the median over the axes), their ratio."""

    published: float
    computed: float

    @property
    def ratio(self) -> float:
        """Computed over published."""
        return self.computed / self.published


Table = Mapping[str, Entry]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ArticleTables:
    """Both tables under one reading."""

    reading: Reading
    coarse: RigCovariance
    precise: RigCovariance

    def by_mode(self, modes: Sequence[str]) -> dict[str, RigCovariance]:
        """Return the covariances of some modes, "coarse" and "precise"."""
        return {m: self.precise if m == "precise" else self.coarse for m in modes}

    @property
    def table1(self) -> Table:
        """Without the rig's angle."""
        return _table(self.coarse, PUBLISHED_COARSE)

    @property
    def table2(self) -> Table:
        """With the rig's angle."""
        return _table(self.precise, PUBLISHED_PRECISE)

    @property
    def ratios(self) -> FloatArray:
        """Computed over published of all twelve, table 1 first, shape (12,)."""
        return np.array([e.ratio for t in (self.table1, self.table2) for e in t.values()])

    @property
    def rms_log(self) -> float:
        """The root mean square of ln(ratio) over all twelve."""
        return rms_log(self.ratios)


def rms_log(ratios: FloatArray) -> float:
    """Return the root mean square of the logarithms of ratios."""
    return float(np.sqrt(np.mean(np.log(ratios) ** 2)))


def _table(found: RigCovariance, published: Mapping[str, float]) -> Table:
    out: dict[str, Entry] = {}
    for key, (group, unit) in ENTRIES.items():
        sigmas = [
            found.sigma(name)
            for name in found.names
            if rig_library().parameter(name).family == group
        ]
        out[key] = Entry(published=published[key], computed=float(np.median(sigmas)) / unit)
    return out


class ArticleAnalysis:
    """The article's analysis, linearised once for all readings."""

    def __init__(self) -> None:
        self._made: dict[tuple[bool, bool], LinearisedFilter] = {}

    def tables(self, reading: Reading) -> ArticleTables:
        """Compute both tables under a reading."""
        return ArticleTables(
            reading=reading, coarse=self.coarse(reading), precise=self.precise(reading)
        )

    def coarse(self, reading: Reading) -> RigCovariance:
        """Compute the covariance without the rig's angle."""
        return self._solve(self._linearised(angle=False, remounted=False), reading)

    def precise(self, reading: Reading) -> RigCovariance:
        """Compute the covariance with the rig's angle."""
        made = self._linearised(angle=True, remounted=reading.remounted)
        prior = made.rig.prior
        if reading.base == "known":
            prior = replace(prior, base_sigma_rad=KNOWN_RAD)
        return self._solve(replace(made, rig=replace(made.rig, prior=prior)), reading)

    def _solve(self, made: LinearisedFilter, reading: Reading) -> RigCovariance:
        """Run the filter with a reading's noise: the linearisation does not depend on it."""
        r, q = made.steps.r.copy(), made.steps.q.copy()
        r[:, :3] *= reading.accel_factor**2
        q[:, :3] *= reading.gyro_factor**2
        azimuth = reading.azimuth_arcmin
        return solve(
            replace(made, steps=replace(made.steps, r=r, q=q)),
            azimuth_sigma_rad=None if azimuth is None else azimuth * ARCMIN,
            carry=reading.carried,
            one_base=reading.base == "same",
        )

    def _linearised(self, *, angle: bool, remounted: bool) -> LinearisedFilter:
        key = (angle, remounted)
        if key not in self._made:
            programme = article_programme()
            sensors = sensor_model((*BASIC, TIME_OFFSET) if angle else BASIC)
            prior = make_prior(sensors)
            if remounted:
                prior = replace(prior, mount_sigma_rad=KNOWN_RAD, remount_sigma_rad=MOUNT_SIGMA_RAD)
            self._made[key] = linearise(programme, sensors, prior, NOISE, angle=angle)
        return self._made[key]


def article_readings() -> Iterator[Reading]:
    """Return the readings that are scanned: all combinations of what may have been meant."""
    bases: tuple[Base, ...] = ("known", "same", "free")
    for accel, gyro, carried, azimuth, base, remounted in product(
        (1.0, 4.0), (1.0, 0.5), (False, True), (None, 1.0, 60.0), bases, (False, True)
    ):
        yield Reading(
            accel_factor=accel,
            gyro_factor=gyro,
            carried=carried,
            azimuth_arcmin=azimuth,
            base=base,
            remounted=remounted,
        )


def best_reading(analysis: ArticleAnalysis | None = None) -> tuple[Reading, float]:
    """Find the reading with the smallest rms of ln(computed/published) over all twelve entries.

    Returns
    -------
    Reading, float
        It, and its rms.
    """
    analysis = analysis or ArticleAnalysis()
    coarse: dict[Reading, FloatArray] = {}
    best = (LITERAL, np.inf)
    for reading in article_readings():
        alike = replace(reading, base="free", remounted=False)  # what coarse mode sees of it
        if alike not in coarse:
            coarse[alike] = _ratios(_table(analysis.coarse(reading), PUBLISHED_COARSE))
        precise = _ratios(_table(analysis.precise(reading), PUBLISHED_PRECISE))
        rms = rms_log(np.concatenate([coarse[alike], precise]))
        if rms < best[1]:
            best = (reading, rms)
    return best


def _ratios(table: Table) -> FloatArray:
    return np.array([entry.ratio for entry in table.values()])
