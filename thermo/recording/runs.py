"""Recorded chamber runs in memory: checked once, never changed.

Every reading is a row; a row's (run, serial) tells which accelerometer read it in which run. What
the outputs mean (unit, gravity, nominal scale) comes from the file and is kept for each
(run, serial), so that files of different makers can be joined and still be told apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from types import MappingProxyType

import numpy as np
import pandas as pd

from errormodel.arrays import constant, readonly, sealed
from errormodel.errors import InputError
from thermo.recording.digest import RunDigest
from thermo.recording.labels import BoolArray, FloatArray, IntArray, Labels, pairs, present_only
from thermo.recording.output_scale import OutputScale, OutputUnit
from thermo.recording.signals import recorded_signals

REQUIRED = ("run", "serial", "time_s", "temp_c", "output")
FORCES = ("a_i_g", "a_p_g", "a_o_g")
NUMBERS = ("time_s", "temp_c", "position_deg", "output", "chamber_c", *FORCES)
COLUMNS = ("run", "serial", "time_s", "temp_c", "position_deg", "output", "chamber_c", *FORCES)
GOOD_FLAGS = frozenset({"", "0", "0.0", "ok"})
PIECE = 1 << 17  # readings that are written or digested at a time: some 15 MB

__all__ = [
    "BoolArray",
    "FloatArray",
    "IntArray",
    "Labels",
    "OutputScale",
    "OutputUnit",
    "RecordedRuns",
    "pairs",
    "present_only",
]


def number_columns() -> tuple[str, ...]:
    """Return the columns of numbers: those of every run, and the recorded signals in use."""
    return (*NUMBERS, *(one.name for one in recorded_signals()))


def _no_more() -> Mapping[str, FloatArray]:
    return MappingProxyType({})


def _no_starts() -> Mapping[str, datetime]:
    return MappingProxyType({})


def _no_mounts() -> Mapping[tuple[str, str], float]:
    return MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecordedRuns:
    """Readings of one or more runs; n rows, arrays read-only.

    Build one with `thermo.recording.files.make_runs` or `read_runs`, which check it. A cell that
    was not given is NaN. Within a (run, serial) time increases strictly.

    Attributes
    ----------
    run, serial, flag : Labels
        An empty flag is a good reading.
    time_s : ndarray, shape (n,)
        From the start of the row's own run, s.
    temp_c, chamber_c : ndarray, shape (n,)
        The accelerometer's own thermistor; the chamber. °C.
    position_deg : ndarray, shape (n,)
        Angle of the indexing head, °.
    output : ndarray, shape (n,)
        In the unit of `scale_of(run, serial)`.
    a_g : ndarray, shape (n, 3)
        Specific force along (IA, PA, OA) as given in the file, g.
    more : mapping of str to ndarray, shape (n,)
        The recorded signals that the file has, by column (`thermo.recording.signals`).
    scales : mapping
        (run, serial) → `OutputScale`.
    run_start_utc : mapping
        Run id → start, for the runs where it is known.
    mount_deg : mapping
        (run, serial) → how far it was mounted turned on the head, °, where it was.
    source : str
        Where it came from, for messages.
    """

    run: Labels
    serial: Labels
    flag: Labels
    time_s: FloatArray
    temp_c: FloatArray
    position_deg: FloatArray
    output: FloatArray
    chamber_c: FloatArray
    a_g: FloatArray
    scales: Mapping[tuple[str, str], OutputScale]
    more: Mapping[str, FloatArray] = field(default_factory=_no_more)
    run_start_utc: Mapping[str, datetime] = field(default_factory=_no_starts)
    mount_deg: Mapping[tuple[str, str], float] = field(default_factory=_no_mounts)
    source: str = "the record"

    def __post_init__(self) -> None:
        for name in ("time_s", "temp_c", "position_deg", "output", "chamber_c", "a_g"):
            object.__setattr__(self, name, readonly(getattr(self, name)))
        more = {name: readonly(values) for name, values in self.more.items()}
        object.__setattr__(self, "more", MappingProxyType(more))
        for labels in (self.run, self.serial, self.flag):
            labels.codes.flags.writeable = False
        object.__setattr__(self, "scales", MappingProxyType(dict(self.scales)))
        object.__setattr__(self, "run_start_utc", MappingProxyType(dict(self.run_start_utc)))
        object.__setattr__(self, "mount_deg", MappingProxyType(dict(self.mount_deg)))

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def run_ids(self) -> tuple[str, ...]:
        """The runs, in order of first appearance."""
        return self.run.names

    @property
    def serials(self) -> tuple[str, ...]:
        """The accelerometers, in order of first appearance."""
        return self.serial.names

    @property
    def good(self) -> BoolArray:
        """Rows that fits use, shape (n,): those without a flag."""
        bad = np.array([name != "" for name in self.flag.names], dtype=np.bool_)
        return ~bad[self.flag.codes]

    @property
    def output_scale(self) -> OutputScale:
        """Unit and scale of all outputs; `InputError` when they differ: select first."""
        return self._only_scale()

    @property
    def output_unit(self) -> OutputUnit:
        """The unit of all outputs; `InputError` when they differ: select first."""
        return self._only_scale().output_unit

    @property
    def gravity_m_s2(self) -> float:
        """Gravity at the place of all readings, m/s²; `InputError` when it differs."""
        return self._only_scale().gravity_m_s2

    @property
    def nominal_scale(self) -> float:
        """Output unit per g of all readings; `InputError` when it differs."""
        return self._only_scale().nominal_scale

    @property
    def has_input(self) -> bool:
        """True when the specific force is known in every good row.

        When it is not, the input is an unknown constant: only bias-like terms can be had.
        """
        return bool(np.all((self._given() | ~np.isnan(self.position_deg))[self.good]))

    @property
    def specific_force_g(self) -> FloatArray:
        """Specific force along (IA, PA, OA), g, shape (n, 3).

        From the head's angle θ, with the mounting's added, it is (sin θ, cos θ, 0); `a_*_g` given
        in a row override that, and those of the three that were not given are 0. A flagged row
        without an input has NaN.

        Raises
        ------
        InputError
            If good rows have neither.
        """
        if not self.has_input:
            raise InputError(
                self.source, "", "has neither position_deg nor a_i_g, a_p_g, a_o_g: input unknown"
            )
        given = self._given()
        force = head_force_g(self.position_deg + self._turned_deg())
        force[given] = np.nan_to_num(self.a_g[given], nan=0.0)
        return force

    def scale_of(self, run: str, serial: str) -> OutputScale:
        """Return what the outputs of an accelerometer in a run are measured in."""
        return self.scales[(run, serial)]

    def select(
        self, serial: str | None = None, runs: Sequence[str] | None = None
    ) -> "RecordedRuns":
        """Return the rows of one accelerometer, of some runs, or of both.

        Parameters
        ----------
        serial : str, optional
            The accelerometer; all when left out.
        runs : sequence of str, optional
            Run ids; all when left out.

        Raises
        ------
        InputError
            If there is no such accelerometer or run, or it was not in these runs.
        """
        keep = np.ones(len(self), dtype=np.bool_)
        if serial is not None:
            keep &= self.serial.codes == self._index(self.serials, serial, "serial")
        if runs is not None:
            wanted = [self._index(self.run_ids, run, "run") for run in runs]
            keep &= np.isin(self.run.codes, wanted)
        if not keep.any():
            raise InputError(self.source, "", f"no reading of serial {serial!r} in runs {runs!r}")
        return self.take(keep)

    def take(self, rows: BoolArray | IntArray) -> "RecordedRuns":
        """Return some rows, by mask or by index, as a record of its own."""
        run, serial = self.run.take(rows), self.serial.take(rows)
        return RecordedRuns(
            run=run,
            serial=serial,
            flag=self.flag.take(rows),
            time_s=sealed(self.time_s[rows]),
            temp_c=sealed(self.temp_c[rows]),
            position_deg=sealed(self.position_deg[rows]),
            output=sealed(self.output[rows]),
            chamber_c=sealed(self.chamber_c[rows]),
            a_g=nothing(len(run.codes)) if self.a_g.strides == (0, 0) else sealed(self.a_g[rows]),
            more={name: sealed(values[rows]) for name, values in self.more.items()},
            scales={key: self.scales[key] for key in pairs(run, serial)},
            run_start_utc={r: t for r, t in self.run_start_utc.items() if r in run.names},
            mount_deg=present_only(self.mount_deg, run, serial),
            source=self.source,
        )

    def flagged(self, flags: Mapping[int, str]) -> "RecordedRuns":
        """Return the same readings with a flag in some rows, by the row's index."""
        names = tuple(dict.fromkeys((*self.flag.names, *flags.values())))
        codes = self.flag.codes.copy()
        for row, flag in flags.items():
            codes[row] = names.index(flag)
        return replace(self, flag=Labels(codes, names))

    def digest(self, run: str) -> str:
        """Return the SHA-256 of a run's content, hexadecimal.

        It is the same whatever the file format, the order of the accelerometers in the file, the
        name of the run and the signals of one's own that are read: a run copied under another name
        is found out.
        """
        of_run = np.flatnonzero(self.run.codes == self._index(self.run_ids, run, "run"))
        serial_codes = self.serial.codes[of_run]
        digest = RunDigest()
        present: list[int] = np.unique(serial_codes).tolist()
        for code in sorted(present, key=self.serials.__getitem__):
            rows, serial = of_run[serial_codes == code], self.serials[code]
            turned = self.mount_deg.get((run, serial), 0.0)
            digest.begin(serial, self.scale_of(run, serial), turned, rows.size)
            for begin in range(0, rows.size, PIECE):
                some = rows[begin : begin + PIECE]
                flags = self.flag.texts_of(some)
                digest.add([n[some] for n in self.digested()], flags)
        return digest.hexdigest()

    def frame(self) -> pd.DataFrame:
        """Return a copy as a table with the columns of the file format that are in use."""
        return self.frame_of(slice(None), self.columns_in_use())

    def columns_in_use(self) -> tuple[str, ...]:
        """Return which columns of the file format hold anything."""
        numbers = self.numbers()
        used = [n for n in numbers if n in REQUIRED or not np.all(np.isnan(numbers[n]))]
        used += ["run", "serial"] + ([] if self.good.all() else ["flag"])
        return tuple(name for name in (*COLUMNS, *self.more, "flag") if name in used)

    def frame_of(self, rows: slice, names: Sequence[str]) -> pd.DataFrame:
        """Return a copy of some rows and columns as a table."""
        texts = {"run": self.run, "serial": self.serial, "flag": self.flag}
        numbers = self.numbers()
        return pd.DataFrame(
            {n: texts[n].text(rows) if n in texts else numbers[n][rows].copy() for n in names}
        )

    def numbers(self) -> dict[str, FloatArray]:
        """Return the columns of numbers by name, in the order of `NUMBERS`, then further ones."""
        numbers = {name: getattr(self, name) for name in NUMBERS if name not in FORCES}
        forces = {name: self.a_g[:, i] for i, name in enumerate(FORCES)}
        return {**numbers, **forces, **self.more}

    def digested(self) -> tuple[FloatArray, ...]:
        """Return the columns that a run's digest is made of: those of every run."""
        numbers = self.numbers()
        return tuple(numbers[name] for name in NUMBERS)

    def _turned_deg(self) -> FloatArray:
        """Return each row's mounting angle on the head, °, shape (n,)."""
        turned = np.zeros(len(self))
        for (run, serial), angle in self.mount_deg.items():
            mine = self.run.codes == self.run_ids.index(run)
            turned[mine & (self.serial.codes == self.serials.index(serial))] = angle
        return turned

    def _given(self) -> BoolArray:
        return np.any(~np.isnan(self.a_g), axis=1)

    def _only_scale(self) -> OutputScale:
        found = set(self.scales.values())
        if len(found) != 1:
            raise InputError(
                self.source, "", f"{len(found)} different output units, gravities or nominal scales"
            )
        return found.pop()

    def _index(self, names: tuple[str, ...], name: str, what: str) -> int:
        if name not in names:
            raise InputError(
                self.source, "", f"no {what} {name!r}; expected one of {', '.join(names):.200}"
            )
        return names.index(name)


def head_force_g(position_deg: FloatArray) -> FloatArray:
    """Compute the specific force along (IA, PA, OA) on a head at rest, shape (n, 3), g.

    It is (sin θ, cos θ, 0), rounded to 1e-15 g so that sin 180° is 0: a product of two forces
    that is zero at every position is then seen to be zero.
    """
    turned = np.deg2rad(position_deg)
    force = np.empty((turned.size, 3))
    np.sin(turned, out=force[:, 0])
    np.cos(turned, out=force[:, 1])
    np.multiply(turned, 0.0, out=force[:, 2])
    np.round(force, 15, out=force)
    return force


def nothing(n: int) -> FloatArray:
    """Return forces (n, 3) of which none was given, without room for them."""
    return np.broadcast_to(constant(np.nan, 1), (n, 3))
