"""A rig's programme: for each cycle the instrument axis that is turned, and its rate over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from errormodel.arrays import FloatArray
from errormodel.io.toml import read_toml

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Segment(_Part):
    """A constant rate for some time; the change to it takes place at its beginning."""

    rate_deg_s: Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
    duration_s: Annotated[float, Field(gt=0, le=86400, allow_inf_nan=False)]


class Cycle(_Part):
    """The rotation about one instrument axis."""

    axis: Literal["x", "y", "z"]
    segments: Annotated[tuple[Segment, ...], Field(min_length=1, max_length=10_000)]
    start_deg: Finite = 0.0
    repeats: Annotated[int, Field(ge=1, le=10_000)] = 1


class Programme(_Part):
    """The programme of a rig calibration, as its TOML file gives it.

    With `acceleration_deg_s2` the rate changes that fast; without it at once.
    """

    cycles: Annotated[tuple[Cycle, ...], Field(min_length=1, max_length=100)]
    latitude_deg: Annotated[float, Field(ge=-89, le=89)] = 55.75
    height_m: Annotated[float, Field(ge=-500, le=10_000)] = 150.0
    azimuth_deg: Finite = 0.0
    acceleration_deg_s2: Positive | None = None
    pause_s: Annotated[float, Field(ge=0, le=86400)] = 60.0


def read_programme(path: Path | str) -> Programme:
    """Read a programme.

    Raises
    ------
    InputError
        If it cannot be read or a key is not what it should be.
    """
    return read_toml(path, Programme)


def there_and_back(
    rates_deg_s: Sequence[float],
    cycle_s: float,
    axes: Sequence[str] = ("x", "y", "z"),
    **rest: object,
) -> Programme:
    """Return a programme in which each cycle shares its time evenly among the rates given."""
    part = cycle_s / len(rates_deg_s)
    segments = [{"rate_deg_s": rate, "duration_s": part} for rate in rates_deg_s]
    cycles = [{"axis": axis, "segments": segments} for axis in axes]
    return Programme.model_validate({"cycles": cycles, **rest})


def article_programme() -> Programme:
    """Return the article's: three cycles of 15 minutes, half at +10 °/s and half at −10 °/s."""
    return there_and_back((10.0, -10.0), 900.0)


def experiment_programme() -> Programme:
    """Return the article's experiment: three cycles of 40 minutes at 2 and 5 °/s, both ways."""
    return there_and_back((2.0, -2.0, 5.0, -5.0), 2400.0, acceleration_deg_s2=10.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AngleLaw:
    """The angle of one cycle: uniformly accelerated between `knots`, exact at any time.

    Attributes
    ----------
    knot_s, angle, rate, accel : ndarray, shape (k,)
        Time of a knot, and from it on angle (rad), rate and acceleration.
    """

    knot_s: FloatArray
    angle: FloatArray
    rate: FloatArray
    accel: FloatArray
    duration_s: float

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return angle, rate and acceleration at times, each of their shape."""
        k = np.clip(np.searchsorted(self.knot_s, time_s, "right") - 1, 0, self.knot_s.size - 1)
        since = time_s - self.knot_s[k]
        angle = self.angle[k] + since * (self.rate[k] + 0.5 * since * self.accel[k])
        return angle, self.rate[k] + since * self.accel[k], self.accel[k]


def angle_law(cycle: Cycle, acceleration_deg_s2: float | None) -> AngleLaw:
    """Return the angle over time of a cycle.

    Raises
    ------
    ValueError
        If a segment is too short for the change of rate at its beginning.
    """
    knots: list[tuple[float, float, float, float]] = []
    now_s, angle, rate = 0.0, float(np.deg2rad(cycle.start_deg)), 0.0
    for segment in cycle.segments * cycle.repeats:
        wanted, left_s = float(np.deg2rad(segment.rate_deg_s)), segment.duration_s
        if acceleration_deg_s2 is not None and wanted != rate:
            accel = float(np.sign(wanted - rate) * np.deg2rad(acceleration_deg_s2))
            change_s = (wanted - rate) / accel
            if change_s > left_s:
                raise ValueError(
                    f"a segment of {segment.duration_s:g} s at {segment.rate_deg_s:g} °/s is "
                    f"shorter than the {change_s:.3g} s that the change of rate takes"
                )
            knots.append((now_s, angle, rate, accel))
            angle += change_s * (rate + 0.5 * change_s * accel)
            now_s, left_s = now_s + change_s, left_s - change_s
        rate = wanted
        knots.append((now_s, angle, rate, 0.0))
        angle, now_s = angle + rate * left_s, now_s + left_s
    columns = np.array(knots).T
    return AngleLaw(
        knot_s=columns[0],
        angle=columns[1],
        rate=columns[2],
        accel=columns[3],
        duration_s=now_s,
    )
