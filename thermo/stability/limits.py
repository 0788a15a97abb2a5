"""Limits that runs must keep, what happened between the runs, and the verdict on both."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from errormodel.errors import InputError
from errormodel.io.toml import read_toml

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Verdict = Literal["pass", "fail", "undecided", "not judged"]
# An accelerometer within all its limits is failed in this share of cases, however many limits.
FALSE_ALARM = 0.05


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class CoefficientLimits(_Part):
    """Limits of one coefficient, in the unit it is reported in."""

    sigma_run: Positive | None = None
    max_minus_min: Positive | None = None


class CurveLimits(_Part):
    """Limits of the distance between the runs' K0 curves, µg."""

    rms: Positive | None = None
    max: Positive | None = None


class GradeLimits(_Part):
    """Limits of a grade for K0 over temperature, µg: see `thermo.stability.shape.Shape`."""

    spread_ug: Positive | None = None
    bend_ug: Positive | None = None


class Between(_Part):
    """Handling between two runs; None where it is not stated."""

    after: str
    before: str | None = None
    power_off: bool | None = None
    rest_h: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    remount: bool | None = None
    note: str = ""


class LimitsFile(_Part):
    """LIMITS.toml: limits by coefficient, grades from the best, and what happened in between."""

    limits: dict[str, CoefficientLimits] = {}
    curve_ug: CurveLimits = CurveLimits()
    grades: dict[str, GradeLimits] = {}
    between: tuple[Between, ...] = ()


def read_limits(path: Path | str) -> LimitsFile:
    """Read LIMITS.toml.

    Raises
    ------
    InputError
        If it cannot be read or holds a key that is not known.
    """
    return read_toml(path, LimitsFile)


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """One limit held against what the runs say.

    `bounds` hold the true value, each wrong in a share of cases that, summed over the criteria of
    an accelerometer, is 5 %. Above the limit altogether: fail; below: pass; else undecided.
    """

    name: str
    value: float
    bounds: tuple[float, float]
    limit: float
    unit: str

    @property
    def verdict(self) -> Verdict:
        """Verdict of the bounds on the limit."""
        if self.bounds[0] > self.limit:
            return "fail"
        return "pass" if self.bounds[1] <= self.limit else "undecided"


def verdict_of(criteria: Sequence[Criterion]) -> Verdict:
    """Return the verdict on an accelerometer: the worst of its criteria."""
    found = {c.verdict for c in criteria}
    order: tuple[Verdict, ...] = ("fail", "undecided", "pass")
    for verdict in order:
        if verdict in found:
            return verdict
    return "not judged"


def grades_of(
    grades: Mapping[str, GradeLimits],
    spread_ug: tuple[float, float],
    bend_ug: tuple[float, float],
) -> tuple[str | None, str | None]:
    """Return the best grade that is shown to be kept, and the best that is not excluded.

    A grade means the same whatever the number of runs: one that is given is wrong in 2.5 % of
    cases at most for each of its limits; few runs give a worse grade, or none.

    Parameters
    ----------
    grades : mapping of str to GradeLimits
        From the best.
    spread_ug, bend_ug : pair of float
        95 % limits.

    Returns
    -------
    str or None, str or None
        None without grades, or where not even the last is kept.
    """

    def first(side: int) -> str | None:
        for name, limits in grades.items():
            pairs = ((limits.spread_ug, spread_ug[side]), (limits.bend_ug, bend_ug[side]))
            if all(limit is None or value <= limit for limit, value in pairs):
                return name
        return None

    return first(1), first(0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """Interval between two runs that follow one another."""

    after: str
    before: str
    power_off: bool | None
    rest_h: float | None
    remount: bool | None
    note: str

    @property
    def facts(self) -> str:
        """Say it; what is not known is called so."""
        yes_no = {True: "yes", False: "no", None: "not stated"}
        rest = "not stated" if self.rest_h is None else f"{self.rest_h:.3g} h"
        text = f"power off {yes_no[self.power_off]}, rest {rest}, remounted {yes_no[self.remount]}"
        return f"{text}; {self.note}" if self.note else text


def intervals_between_runs(
    order: Sequence[str],
    stated: Sequence[Between],
    starts: Mapping[str, datetime],
    spans_s: Mapping[str, float],
) -> tuple[Interval, ...]:
    """Put together what is known of the times between runs.

    Parameters
    ----------
    order : sequence of str
        The runs in their order.
    stated : sequence of Between
    starts : mapping of str to datetime
        Where known.
    spans_s : mapping of str to float
        Time of the last reading of each run.

    Raises
    ------
    InputError
        If something is stated of a run that is not there or does not come next.
    """
    pairs = list(pairwise(order))
    for one in stated:
        if one.after not in order[:-1]:
            known = ", ".join(order[:-1])
            problem = f"no run {one.after!r} that another follows; expected one of {known}"
            raise InputError("between", "after", problem)
        follower = dict(pairs)[one.after]
        if one.before not in (None, follower):
            problem = f"run {one.after!r} is followed by {follower!r}, not by {one.before!r}"
            raise InputError("between", "before", problem)
    return tuple(_intervals(pairs, {b.after: b for b in stated}, starts, spans_s))


def _intervals(
    pairs: Sequence[tuple[str, str]],
    stated: Mapping[str, Between],
    starts: Mapping[str, datetime],
    spans_s: Mapping[str, float],
) -> Iterator[Interval]:
    for after, before in pairs:
        said = stated.get(after, Between(after=after))
        rest_h = said.rest_h
        if rest_h is None and after in starts and before in starts:
            gap_s = (starts[before] - starts[after]).total_seconds() - spans_s[after]
            # runs that overlap were not timed by one clock, as those of emulated instruments
            rest_h = gap_s / 3600.0 if gap_s >= 0.0 else None
        yield Interval(
            after=after,
            before=before,
            power_off=said.power_off,
            rest_h=rest_h,
            remount=said.remount,
            note=said.note,
        )
