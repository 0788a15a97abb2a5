"""The mapping file: how somebody else's log is to be read.

Columns are named as in the log's header, or numbered from 1.
"""

import codecs
import re
from datetime import datetime
from typing import Annotated, Literal, TypeAlias
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    field_validator,
    model_validator,
)

from thermo.recording.files import Sidecar
from thermo.recording.signals import recorded_signals

Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
Name = Annotated[str, StringConstraints(strict=True, strip_whitespace=True, min_length=1)]
Column: TypeAlias = Annotated[int, Field(ge=1, strict=True)] | Name
Value: TypeAlias = Finite | Name  # a constant, or the name of a column

TIME_UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
# each unit in terms of the first of its kind
UNITS = {
    "m/s2": ("m/s2", 1.0),
    "g": ("g", 1.0),
    "mg": ("g", 1e-3),
    "ug": ("g", 1e-6),
    "A": ("mA", 1e3),
    "mA": ("mA", 1.0),
    "uA": ("mA", 1e-3),
    "V": ("V", 1.0),
    "mV": ("V", 1e-3),
    "uV": ("V", 1e-6),
    "count": ("count", 1.0),
}
Unit: TypeAlias = Literal["m/s2", "g", "mg", "ug", "A", "mA", "uA", "V", "mV", "uV", "count"]


class MappingTable(BaseModel):
    """A table of the mapping file; a key it does not know is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class FileFormat(MappingTable):
    """Format of cells and lines."""

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    header: bool = True  # names stand in the first line that is read
    skip_lines: Annotated[int, Field(ge=0)] = 0  # before the header
    comment: str = ""  # lines that begin so are left out
    encoding: str = "utf-8-sig"
    decimal: Literal[".", ","] = "."

    @field_validator("encoding")
    @classmethod
    def _is_known(cls, value: str) -> str:
        try:
            "0".encode(value)
            if "escape" in codecs.lookup(value).name:
                raise ValueError
        except (LookupError, ValueError, TypeError, AttributeError):
            raise ValueError("expected the name of a text encoding, like utf-8") from None
        return value

    @model_validator(mode="after")
    def _check(self) -> "FileFormat":
        if self.delimiter in '"\r\n\0':
            raise ValueError("delimiter must not be a quote or the end of a line")
        if self.delimiter == self.decimal:
            raise ValueError(f"delimiter and decimal are both {self.decimal!r}")
        return self


class TimeColumn(MappingTable):
    """Time of a row: a number of `unit` (or of `scale` seconds), or a date by `format`.

    With `date` the day stands in a column of its own; `format` then is of both, joined by a blank.
    A `format` without a day counts on over midnight. `zone` is the time zone of dates that do not
    tell theirs, like "Europe/Berlin": a day on which the clocks change is then placed rightly.
    """

    column: Column
    date: Column | None = None
    zone: str | None = None
    wrap_bits: Annotated[int, Field(ge=8, le=64)] | None = None  # of a counter that begins anew
    unit: Literal["s", "ms", "us", "ns", "min", "h"] | None = None
    scale: Positive | None = None  # seconds per unit
    format: str | None = None  # "iso", or as of strptime, like "%d.%m.%Y %H:%M:%S"
    start: Literal["first", "zero"] = "first"  # zero: the log counts from the run's start

    @model_validator(mode="after")
    def _check(self) -> "TimeColumn":
        if sum(given is not None for given in (self.unit, self.scale, self.format)) != 1:
            raise ValueError("expected exactly one of unit, scale and format")
        if self.format is None and (self.date is not None or self.zone is not None):
            raise ValueError("date and zone go with format only")
        if self.wrap_bits is not None and self.format is not None:
            raise ValueError("wrap_bits is for counters, not for dates")
        if self.format is not None:
            if self.start == "zero":
                raise ValueError('start = "zero" does not go with dates')
            if self.format != "iso":
                try:
                    datetime.strptime(datetime(2026, 1, 2).strftime(self.format), self.format)
                except (ValueError, IndexError, KeyError) as err:
                    raise ValueError(f"format {self.format!r:.60}: {err}") from None
        return self

    @field_validator("zone")
    @classmethod
    def _is_zone(cls, value: str | None) -> str | None:
        try:
            if value is not None:
                ZoneInfo(value)
        except (ZoneInfoNotFoundError, ValueError, OSError):
            what = f"no time zone {value!r:.60}, expected one like Europe/Berlin"
            raise ValueError(what) from None
        return value

    @property
    def without_day(self) -> bool:
        """True when the format is of a time of day alone."""
        day = re.search(r"%[djxcDFU]", self.format or "%d")
        return self.format != "iso" and day is None

    @property
    def local(self) -> bool:
        """True when it holds dates of which the time zone is not stated here."""
        return self.format is not None and self.zone is None and not self.without_day

    @property
    def unit_s(self) -> float:
        """Seconds per unit of the column."""
        return self.scale if self.scale is not None else TIME_UNITS_S[self.unit or "s"]


class Temperature(MappingTable):
    """A column of temperatures."""

    column: Column
    unit: Literal["C", "K", "F"] = "C"
    scale: Finite = 1.0  # applied first: unit = scale · cell + offset
    offset: Finite = 0.0


class RecordedSignal(MappingTable):
    """A column of a recorded signal (`thermo.recording.signals`): scale · cell + offset."""

    column: Column
    scale: Finite = 1.0
    offset: Finite = 0.0


class Where(MappingTable):
    """Rows in which a column equals a text, or a number."""

    column: Column
    equals: Annotated[str, Field(strict=True)] | Finite


class Runs(MappingTable):
    """Run of a row: one id for all, a column, or a new run after each gap in time."""

    id: Name | None = None
    column: Column | None = None
    gap_s: Positive | None = None  # runs are numbered from 1

    @model_validator(mode="after")
    def _check(self) -> "Runs":
        if sum(given is not None for given in (self.id, self.column, self.gap_s)) != 1:
            raise ValueError("expected exactly one of id, column and gap_s")
        return self


class Accelerometer(MappingTable):
    """One accelerometer: which column is its output, and how it stood."""

    serial: Name
    column: Column
    unit: Unit | None = None  # of the column after `scale`; that of [output] when left out
    scale: Finite = 1.0
    sign: Literal[-1, 1] = 1
    signed: bool = False  # the column's whole numbers of `bits` are two's complement
    bits: Annotated[int, Field(ge=2, le=64)] | None = None
    position_deg: Value | None = None
    a_i_g: Value | None = None
    a_p_g: Value | None = None
    a_o_g: Value | None = None
    temperature: Temperature | None = None  # its own; that of the log when left out
    only: Where | None = None  # for logs with one reading a row

    @field_validator("scale")
    @classmethod
    def _not_zero(cls, value: float) -> float:
        if value == 0:
            raise ValueError("must not be 0")
        return value

    @model_validator(mode="after")
    def _check(self) -> "Accelerometer":
        if self.signed and self.bits is None:
            raise ValueError("signed needs bits, the width of the counts")
        return self


class Output(Sidecar):
    """Unit and scale of the recorded run's outputs; as in its sidecar."""


class FlagRule(MappingTable):
    """Rows in which a column is not what it should be get a flag."""

    column: Column
    good: Annotated[str, Field(strict=True)] | Finite
    flag: Name = "status"


class RowSelection(MappingTable):
    """Rows to take, counted from 1 without header and comments."""

    first: Annotated[int, Field(ge=1)] = 1
    last: Annotated[int, Field(ge=1)] | None = None
    only: Where | None = None


class LogMap(MappingTable):
    """A whole mapping file."""

    file: FileFormat = FileFormat()
    time: TimeColumn
    temperature: Temperature | None = None
    chamber: Temperature | None = None
    signals: dict[str, RecordedSignal] = {}
    run: Runs = Runs(id="1")
    accelerometers: Annotated[tuple[Accelerometer, ...], Field(min_length=1)]
    output: Output
    flag: tuple[FlagRule, ...] = ()
    rows: RowSelection = RowSelection()
    on_bad_row: Literal["error", "flag"] = "error"

    @model_validator(mode="after")
    def _check(self) -> "LogMap":
        known = [one.name for one in recorded_signals()]
        for name in self.signals:
            if name not in known:
                raise ValueError(
                    f"signals: no signal {name!r}; expected some of "
                    f"{', '.join(known) or 'none'}; a definition of your own needs --library FILE"
                )
        keys = [(a.serial, a.only) for a in self.accelerometers]
        if len(set(keys)) != len(keys):
            raise ValueError("accelerometers: a serial is listed twice")
        for a in self.accelerometers:
            kind = UNITS[a.unit or self.output.output_unit][0]
            if kind != UNITS[self.output.output_unit][0] and {kind, self.output.output_unit} != {
                "m/s2",
                "g",
            }:
                raise ValueError(
                    f"accelerometer {a.serial}: unit {a.unit} cannot become "
                    f"{self.output.output_unit}; give scale and leave unit out"
                )
        return self

    def factor(self, accelerometer: Accelerometer) -> float:
        """Return output per cell of an accelerometer's column."""
        kind, size = UNITS[accelerometer.unit or self.output.output_unit]
        if kind == "g" and self.output.output_unit == "m/s2":
            size *= self.output.gravity_m_s2
        elif kind == "m/s2" and self.output.output_unit == "g":
            size /= self.output.gravity_m_s2
        return size * accelerometer.scale * accelerometer.sign
