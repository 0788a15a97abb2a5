"""The sequence file: what to do with the chamber, the head and the accelerometers, as data.

A sequence says nothing of instruments: those are in the station file. It is checked here as far as
it goes alone; `thermo.planning.plan.make_plan` checks it against a station.
"""

import logging
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, Strict, model_validator

from errormodel.io.toml import check, parse_toml, read_toml
from errormodel.io.toml_write import toml_text
from thermo.planning.run_in_rule import RunInRule

log = logging.getLogger(__name__)

MAX_LEGS = 20_000
MIN_RAMP_C = 0.01  # less than any chamber resolves is no ramp

Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Temp = Annotated[float, Strict(), Field(ge=-200, le=400, allow_inf_nan=False)]
Rate = Annotated[float, Strict(), Field(gt=0, le=100, allow_inf_nan=False)]
Minutes = Annotated[float, Strict(), Field(gt=0, le=100_000, allow_inf_nan=False)]
Count = Annotated[int, Strict(), Field(ge=1, le=10_000)]
Angle = Annotated[float, Strict(), Field(ge=-3600, le=3600, allow_inf_nan=False)]
Serial = Annotated[str, Field(min_length=1, max_length=100)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TestedAccelerometer(_Section):
    """One accelerometer under test; `nominal_scale` is in its output unit per g.

    `mount_deg` is how far it is mounted turned on the head: its input axis stands at the head's
    angle plus this.
    """

    serial: Serial
    nominal_scale: Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
    mount_deg: Annotated[float, Strict(), Field(ge=-360, le=360, allow_inf_nan=False)] = 0.0


class Positions(_Section):
    """Angles of the head and the order they are visited in; "random" is anew in every round."""

    angles_deg: Annotated[tuple[Angle, ...], Field(min_length=1, max_length=1000)]
    order: Literal["fixed", "random"] = "fixed"
    seed: Annotated[int, Strict(), Field(ge=0)] = 1
    readings_per_position: Count = 1

    @model_validator(mode="after")
    def _check(self) -> "Positions":
        if len(set(self.angles_deg)) != len(self.angles_deg):
            raise ValueError("angles_deg: an angle is listed twice")
        return self


class Hold(_Section):
    """Stay at a temperature; without `temp_c`, at the one reached."""

    kind: Literal["hold"]
    duration_min: Minutes
    temp_c: Temp | None = None
    positions: Positions | None = None


class Ramp(_Section):
    """Move the temperature uniformly to `to_c`."""

    kind: Literal["ramp"]
    to_c: Temp
    rate_c_per_min: Rate
    positions: Positions | None = None


class TemperatureCycle(_Section):
    """Short for `count` times: ramp to `high_c`, soak, ramp to `low_c`, soak.

    Begun anywhere but at `low_c`, it goes there first, at the same rate, and soaks.
    """

    kind: Literal["cycle"]
    low_c: Temp
    high_c: Temp
    rate_c_per_min: Rate
    soak_min: Annotated[float, Strict(), Field(ge=0, le=100_000, allow_inf_nan=False)] = 0.0
    count: Count = 1
    positions: Positions | None = None

    @model_validator(mode="after")
    def _check(self) -> "TemperatureCycle":
        if not self.high_c - self.low_c >= MIN_RAMP_C:
            raise ValueError(f"low_c {self.low_c:g} must be below high_c {self.high_c:g}")
        return self


Segment = Annotated[Hold | Ramp | TemperatureCycle, Field(discriminator="kind")]


class Rest(_Section):
    """Chamber temperature while the accelerometers rest unpowered; None: the safe one."""

    temp_c: Temp | None = None


class TemperatureProgramme(_Section):
    """The temperature over one run, and how often it is run.

    A run's time starts when the chamber has come within `start_tolerance_c` of `start_c` and has
    stayed for `start_soak_min`. `approach_c_per_min` is how fast the chamber is expected to go
    somewhere without a ramp: it serves the plan and the patience of the supervision.
    """

    start_c: Temp
    start_tolerance_c: Annotated[float, Strict(), Field(gt=0, le=20, allow_inf_nan=False)] = 0.5
    start_soak_min: Annotated[float, Strict(), Field(ge=0, le=100_000)] = 0.0
    start_timeout_min: Minutes = 240.0
    approach_c_per_min: Rate = 1.0
    segments: Annotated[tuple[Segment, ...], Field(min_length=1, max_length=1000)]
    repeats: Count = 1
    rest_h: Annotated[float, Strict(), Field(ge=0, le=10_000, allow_inf_nan=False)] = 0.0
    rest: Rest = Rest()


class Sampling(_Section):
    """Readings at equal intervals; `switch_s` is what the multimeter needs to change channel."""

    period_s: Annotated[float, Strict(), Field(gt=0, le=86_400, allow_inf_nan=False)]
    settle_s: Annotated[float, Strict(), Field(ge=0, le=3600, allow_inf_nan=False)] = 1.0
    switch_s: Annotated[float, Strict(), Field(ge=0, le=10, allow_inf_nan=False)] = 0.017


class Limits(_Section):
    """Limits beyond which the test is ended safely.

    Every limit has a bound beyond which it would protect nobody; `thermo.planning.bounds` holds
    them, so that a test stored before there was a bound can still be read.

    Attributes
    ----------
    chamber_c, accelerometer_c : pair of float or None
        Allowed temperatures of the chamber and of each accelerometer's thermistor; None takes
        the station's limits for the chamber, widened by 10 °C for the accelerometers. The
        chamber's reading may overshoot by `max_deviation_c`, 5 °C at most, its set point never
        does.
    max_deviation_c, max_deviation_min : float
        The chamber may be this far from the programme, for this long at a stretch.
    stuck_c : float
        The programme may move this far without the chamber's reading moving at all.
    max_failures, max_failure_s : int, float
        An instrument may fail this often in a row, and for this long.
    max_thermistor_losses : int
        An accelerometer's thermistor may give no reading this often in a row: then its
        temperature is no longer limited. One may be a contact, two a contact and its bouncing.
    on_thermistor_lost : str
        "end" the test then, or "pause" it until the operator resumes.
    max_bad_share : float
        Of an accelerometer's slots so many may be missed or flagged in a test that is clean.
    """

    chamber_c: tuple[Temp, Temp] | None = None
    accelerometer_c: tuple[Temp, Temp] | None = None
    max_deviation_c: Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)] = 5.0
    max_deviation_min: Annotated[float, Strict(), Field(ge=0, allow_inf_nan=False)] = 10.0
    stuck_c: Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)] = 3.0
    max_failures: Count = 5
    max_failure_s: Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)] = 300.0
    max_thermistor_losses: Annotated[int, Strict(), Field(ge=1, le=1000)] = 3
    on_thermistor_lost: Literal["end", "pause"] = "end"
    max_bad_share: Annotated[float, Strict(), Field(ge=0, le=0.5)] = 0.1

    @model_validator(mode="after")
    def _check(self) -> "Limits":
        for name in ("chamber_c", "accelerometer_c"):
            pair = getattr(self, name)
            if pair is not None and not pair[0] < pair[1]:
                raise ValueError(f"{name} must be [low, high] with low below high")
        return self


class SelfHeating(_Section):
    """Self-heating of the SINS after power-on, as measured."""

    time_min: Annotated[tuple[Number, ...], Field(min_length=2)]
    temp_c: Annotated[tuple[Temp, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _check(self) -> "SelfHeating":
        if len(self.time_min) != len(self.temp_c):
            raise ValueError("time_min and temp_c must be of one length")
        if any(b <= a for a, b in zip(self.time_min, self.time_min[1:], strict=False)):
            raise ValueError("time_min must increase")
        return self


class Uniformity(_Section):
    """Criterion for a uniform ramp.

    The slope is a least-squares line over `window_min`; the band about the commanded rate is
    `band_fraction` of it, or `band_c_per_min` when given. The first `transient_min` of a ramp, in
    which the chamber and the case take up the new rate, are left out.
    """

    band_fraction: Annotated[float, Strict(), Field(gt=0, le=10, allow_inf_nan=False)] = 0.1
    band_c_per_min: Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)] | None = None
    min_share_inside: Annotated[float, Strict(), Field(gt=0, le=1)] = 0.9
    window_min: Minutes = 5.0
    transient_min: Annotated[float, Strict(), Field(ge=0, allow_inf_nan=False)] = 15.0
    sins_self_heating_rate_c_per_min: Rate | None = None
    sins_self_heating: SelfHeating | None = None

    @model_validator(mode="after")
    def _check(self) -> "Uniformity":
        if self.sins_self_heating_rate_c_per_min is not None and self.sins_self_heating is not None:
            raise ValueError(
                "give sins_self_heating_rate_c_per_min or the table sins_self_heating, not both"
            )
        return self


class AfterGap(_Section):
    """Rule for going on after a pause or an interruption.

    "resoak": the interrupted segment's readings are voided, its starting temperature is held for
    `resoak_min` and the segment is repeated. "accept": the run goes on and the gap is marked; a
    gap longer than `max_gap_s` is treated as by "resoak".
    """

    gap_rule: Literal["resoak", "accept"] = "resoak"
    resoak_min: Annotated[float, Strict(), Field(ge=0, le=100_000, allow_inf_nan=False)] = 20.0
    max_gap_s: Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)] = 600.0


class Sequence(_Section):
    """A chamber test sequence; with `run_in`, its run is repeated until that rule stops it."""

    name: Annotated[str, Field(min_length=1, max_length=200)]
    accelerometers: Annotated[tuple[TestedAccelerometer, ...], Field(min_length=1, max_length=1000)]
    temperature: TemperatureProgramme
    positions: Positions
    sampling: Sampling
    limits: Limits = Limits()
    uniformity: Uniformity = Uniformity()
    after_gap: AfterGap = AfterGap()
    run_in: RunInRule | None = None

    @model_validator(mode="after")
    def _check(self) -> "Sequence":
        legs = sum(
            2 * s.count + 2 if isinstance(s, TemperatureCycle) else 1
            for s in self.temperature.segments
        )
        if legs > MAX_LEGS:
            raise ValueError(f"temperature.segments: {legs} ramps and holds, at most {MAX_LEGS}")
        serials = [a.serial for a in self.accelerometers]
        if len(set(serials)) != len(serials):
            raise ValueError("accelerometers: a serial number is listed twice")
        if self.run_in is not None and self.temperature.repeats != 1:
            raise ValueError("temperature.repeats: leave it out, run_in says how often")
        _check_temperatures(self.temperature, self.limits)
        return self


def _check_temperatures(programme: TemperatureProgramme, limits: Limits) -> None:
    """Follow the programme's temperatures; raise ValueError where one is outside or no ramp."""
    named = [("start_c", programme.start_c)]
    temp_c = programme.start_c
    for index, segment in enumerate(programme.segments):
        place = f"temperature.segments.{index}"
        if isinstance(segment, Hold):
            temp_c = temp_c if segment.temp_c is None else segment.temp_c
        elif isinstance(segment, Ramp):
            if abs(segment.to_c - temp_c) < MIN_RAMP_C:
                raise ValueError(
                    f"{place}: a ramp to {segment.to_c:g} °C begins where it ends; use a hold"
                )
            temp_c = segment.to_c
        else:
            named.append((f"{place}.high_c", segment.high_c))
            temp_c = segment.low_c
        named.append((place, temp_c))
    if programme.rest.temp_c is not None:
        named.append(("temperature.rest.temp_c", programme.rest.temp_c))
    if limits.chamber_c is not None:
        low, high = limits.chamber_c
        for place, value in named:
            if not low <= value <= high:
                raise ValueError(
                    f"{place}: {value:g} °C is outside limits.chamber_c {low:g}…{high:g} °C"
                )


def load_sequence(path: Path | str) -> Sequence:
    """Read a sequence file.

    Raises
    ------
    InputError
        Naming the file and the key that is wrong.
    """
    return read_toml(path, Sequence)


def parse_sequence(text: str, source: str = "sequence") -> Sequence:
    """Read a sequence from TOML text, as the store keeps it.

    Raises
    ------
    InputError
        Naming `source` and the key that is wrong.
    """
    return check(parse_toml(text, source), Sequence, source)


def sequence_toml(sequence: Sequence) -> str:
    """Write a sequence as TOML; `parse_sequence` gives an equal one back.

    Parameters
    ----------
    sequence : Sequence

    Returns
    -------
    str
    """
    return toml_text(sequence.model_dump(mode="json", exclude_none=True))
