"""Record of one channel: named input signals on one time base, cut into runs."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from errormodel.arrays import FloatArray, IntArray, freeze, readonly, readonly_int, sealed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Record:
    """Inputs of one channel, and its output if it has been measured.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Seconds from the start of each run, increasing within a run.
    signals : mapping of str to array_like, shape (n,)
        Input signals by name, with the unit in the name.
    run : array_like of int, shape (n,), optional
        Run number of each reading: 0, 1, …; the readings of a run are consecutive. Default: one
        run.
    output : array_like, shape (n,) or (n, m), optional
        Measured output, in the unit of the model's input; m channels with the same inputs.

    Raises
    ------
    ValueError
        If shapes differ, runs are scattered, or time does not increase within a run.
    """

    time_s: FloatArray
    signals: Mapping[str, FloatArray]
    run: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    output: FloatArray | None = None

    def __post_init__(self) -> None:
        time_s = readonly(self.time_s)
        n = time_s.size
        run = readonly_int(self.run if np.size(self.run) else np.zeros(n))
        signals = {name: readonly(values) for name, values in self.signals.items()}
        output = None if self.output is None else readonly(self.output)
        for name, values in [("run", run), *signals.items()]:
            if values.shape != (n,):
                raise ValueError(f"{name} has shape {values.shape}, expected ({n},)")
        if output is not None and output.shape[:1] != (n,):
            raise ValueError(f"output has shape {output.shape}, expected ({n}, …)")
        if n and (run[0] != 0 or np.any((np.diff(run) != 0) & (np.diff(run) != 1))):
            raise ValueError("run must count 0, 1, … with the readings of a run together")
        if np.any((np.diff(time_s) <= 0) & (np.diff(run) == 0)):
            raise ValueError("time_s must increase within a run")
        freeze(self, time_s=time_s, run=run, signals=MappingProxyType(signals), output=output)

    def __len__(self) -> int:
        return self.time_s.size

    def __getitem__(self, name: str) -> FloatArray:
        return self.signals[name]

    @property
    def run_slices(self) -> tuple[slice, ...]:
        """The readings of each run."""
        edges = np.flatnonzero(np.diff(self.run)) + 1
        starts, stops = [0, *edges.tolist()], [*edges.tolist(), len(self)]
        return tuple(slice(a, b) for a, b in zip(starts, stops, strict=True) if b > a)

    def with_signals(self, **signals: FloatArray) -> "Record":
        """Return the same record with signals replaced or added."""
        checked = {name: readonly(values) for name, values in signals.items()}
        for name, values in checked.items():
            if values.shape != self.time_s.shape:
                raise ValueError(f"{name} has shape {values.shape}, expected {self.time_s.shape}")
        return _unchecked(self.time_s, {**self.signals, **checked}, self.run, self.output)

    def with_only(self, names: Collection[str]) -> "Record":
        """Return the same record with some of its signals."""
        kept = {name: values for name, values in self.signals.items() if name in names}
        return _unchecked(self.time_s, kept, self.run, self.output)

    def view(self, rows: slice) -> "Record":
        """Return consecutive readings without a copy; runs keep their numbers."""
        return _unchecked(
            self.time_s[rows],
            {name: values[rows] for name, values in self.signals.items()},
            self.run[rows],
            None if self.output is None else self.output[rows],
        )

    def take(self, keep: ArrayLike) -> "Record":
        """Return the readings selected by a mask or by indices; runs are renumbered."""
        rows = np.asarray(keep)
        chosen = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        numbers = self.run[chosen]
        anew = np.cumsum(np.bincount(numbers) > 0) - 1  # without sorting the readings
        return Record(
            time_s=sealed(self.time_s[chosen]),
            run=sealed(anew[numbers]),
            signals={name: sealed(values[chosen]) for name, values in self.signals.items()},
            output=None if self.output is None else sealed(self.output[chosen]),
        )


def _unchecked(
    time_s: FloatArray,
    signals: Mapping[str, FloatArray],
    run: IntArray,
    output: FloatArray | None,
) -> Record:
    """Make a record from the arrays of a checked record, without another check."""
    made = object.__new__(Record)
    freeze(made, time_s=time_s, signals=MappingProxyType(dict(signals)), run=run, output=output)
    return made
