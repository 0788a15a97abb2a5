"""One test as the page shows it: programme, readings so far, live estimate, events."""

import threading
from array import array
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from drivers.station import StationConfig
from errormodel.arrays import FloatArray
from thermo.planning.plan import Plan, make_plan
from thermo.planning.sequence import parse_sequence
from thermo.station.observers.live import LiveEstimate, LiveValue
from thermo.store.follow import Place, read_added
from thermo.store.reader import StoreReader
from thermo.store.records import EventRecord, ReadingRow, TestRecord

MOST_SCANS = 8_000  # kept for the pictures; beyond it every second one is left out, again and again
MOST_POINTS = 600  # of a line in a picture
MOST_EVENTS = 500
NAN = float("nan")
Points: TypeAlias = list[list[float | None]]


@dataclass(slots=True)
class _Lines:
    """Quantities over time, thinned so that they never take more memory than `MOST_SCANS`."""

    names: tuple[str, ...]
    stride: int = 1
    _count: int = 0
    hours: "array[float]" = field(default_factory=lambda: array("d"))
    values: "dict[str, array[float]]" = field(init=False)

    def __post_init__(self) -> None:
        self.values = {name: array("d") for name in self.names}

    def add(self, hour: float, values: dict[str, float]) -> None:
        """Take the values of one moment, if it is not one that is left out."""
        self._count += 1
        if (self._count - 1) % self.stride:
            return
        self.hours.append(hour)
        for name, line in self.values.items():
            line.append(values.get(name, NAN))
        if len(self.hours) > MOST_SCANS:
            self.stride *= 2
            self.hours = self.hours[::2]
            self.values = {name: line[::2] for name, line in self.values.items()}


class FollowedTest:
    """A test that is read piece by piece; made and updated by one thread, read by all.

    Parameters
    ----------
    store : StoreReader
    test_id : str

    Raises
    ------
    StoreError
        If there is no such test.
    InputError
        If its sequence or station cannot be read by this program.
    """

    def __init__(self, store: StoreReader, test_id: str) -> None:
        self.record: TestRecord = store.test(test_id)
        sequence = parse_sequence(self.record.sequence_toml, f"test {test_id}")
        station = StationConfig.model_validate_json(self.record.station_json)
        self.plan: Plan = make_plan(sequence, station)
        self.serials = tuple(a.serial for a in sequence.accelerometers)
        self.units = {i.serial: i.output_unit for i in station.inputs}
        self.events: deque[EventRecord] = deque(maxlen=MOST_EVENTS)
        self.readings = 0
        self.flagged = 0
        self.version = 0
        self._place = Place()
        self._lock = threading.Lock()  # of the lines, which pages read while they grow
        self._drawn: dict[str, tuple[int, Points]] = {}
        self._begin()

    def _begin(self) -> None:
        sequence = self.plan.sequence
        self.readings = self.flagged = 0
        self._lines = _Lines(
            ("chamber", "position", *self.serials, *(f"output {s}" for s in self.serials))
        )
        self._estimate = LiveEstimate(
            {a.serial: a.nominal_scale for a in sequence.accelerometers},
            mount_deg={a.serial: a.mount_deg for a in sequence.accelerometers},
        )

    def update(self, store: StoreReader) -> bool:
        """Read on; return True if there is more to be read at once."""
        self.record = store.test(self.record.id)
        added = read_added(store, self.record.id, self._place)
        if added.afresh:
            self._begin()
        self._take(added.readings)
        self.events.extend(added.events)
        self._place = added.place
        if added.readings or added.events or added.afresh:
            self.version += 1
        return added.more

    def _take(self, readings: tuple[tuple[int, ReadingRow], ...]) -> None:
        scan: list[ReadingRow] = []
        before = (0, -1)
        for run, row in readings:
            if (run, row.slot) != before and scan:
                self._take_scan(before[0], scan)
                scan = []
            before = (run, row.slot)
            scan.append(row)
        if scan:
            self._take_scan(before[0], scan)

    def _take_scan(self, run: int, rows: list[ReadingRow]) -> None:
        self._estimate.on_reading(run, rows)
        self.readings += len(rows)
        self.flagged += sum(1 for row in rows if row.flag)
        values = {"chamber": _number(rows[0].chamber_c), "position": _number(rows[0].position_deg)}
        for row in rows:
            values[row.serial] = _number(row.temp_c)
            values[f"output {row.serial}"] = _number(row.output)
        with self._lock:
            self._lines.add(self.hour(run, rows[0].time_s), values)

    # ---- what the pages show

    def hour(self, run: int, time_s: float) -> float:
        """Return the hour of the programme at a time of a run, with approaches and rests."""
        plan = self.plan
        each_s = plan.approach_s + plan.run_s + plan.rest_s
        return ((run - 1) * each_s + plan.approach_s + time_s) / 3600.0

    @property
    def stride(self) -> int:
        """One in so many scans is drawn."""
        return self._lines.stride

    def estimates(self) -> tuple[LiveValue, ...]:
        """Return the live K0 and K1 of every accelerometer that has been read."""
        return self._estimate.values()

    def programme(self) -> Points:
        """Return the programme as [hour, °C], with a gap between runs."""
        found: Points = []
        for run in range(1, min(self.plan.runs, 50) + 1):
            for leg in self.plan.legs:
                found.append([self.hour(run, leg.start_s), leg.start_c])
                found.append([self.hour(run, leg.end_s), leg.end_c])
            found.append([None, None])
        return found

    def line(self, name: str) -> Points:
        """Return a line of the pictures as [hour, value], thinned to what can be seen."""
        return self._once(name, lambda: _points(*self._values(name)))

    def rate(self, name: str = "chamber") -> Points:
        """Return the rate of a temperature over the window of the uniformity rule, °C/min."""
        return self._once(f"rate {name}", lambda: self._rate(*self._values(name)))

    def _rate(self, hours: FloatArray, values: FloatArray) -> Points:
        if hours.size < 2:
            return []
        window_h = self.plan.sequence.uniformity.window_min / 60.0
        at = np.searchsorted(hours, hours - window_h)
        span_h = hours - hours[at]
        inside = (span_h > 0.3 * window_h) & (span_h < 2.0 * window_h)
        rate = np.full(hours.size, NAN)
        rate[inside] = (values - values[at])[inside] / (60.0 * span_h[inside])
        return _points(hours, rate)

    def _values(self, name: str) -> tuple[FloatArray, FloatArray]:
        with self._lock:
            return np.array(self._lines.hours), np.array(self._lines.values[name])

    def _once(self, what: str, make: Callable[[], Points]) -> Points:
        """Make a line once for all pages, until there are new readings."""
        version = self.version
        made = self._drawn.get(what)
        if made is None or made[0] != version:
            made = self._drawn[what] = (version, make())
        return made[1]


def _number(value: float | None) -> float:
    return NAN if value is None else float(value)


def _points(hours: FloatArray, values: FloatArray) -> Points:
    """Thin a line to its ends and, in each piece, the lowest and the highest value."""
    kept = np.arange(hours.size)
    if hours.size > MOST_POINTS:
        pieces = np.array_split(kept, MOST_POINTS // 2)
        ends = {0, int(kept[-1])}
        for piece in pieces:
            inside = piece[np.isfinite(values[piece])]
            if inside.size:
                ends.add(int(inside[np.argmin(values[inside])]))
                ends.add(int(inside[np.argmax(values[inside])]))
        kept = np.array(sorted(ends))
    return [
        [round(float(hours[k]), 5), float(f"{values[k]:.6g}") if np.isfinite(values[k]) else None]
        for k in kept
    ]
