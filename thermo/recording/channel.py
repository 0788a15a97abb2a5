"""From recorded runs to what an error model sees: one accelerometer, good readings only."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import (
    FloatArray,
    IntArray,
    constant,
    freeze,
    readonly,
    sealed,
)
from errormodel.errors import InputError
from errormodel.model import ErrorModel
from errormodel.record import Record
from thermo.recording.files import RecordedRuns
from thermo.recording.runs import BoolArray
from thermo.recording.signals import Conditions, signals_of

# Slower than this share of the fastest change, a reading belongs to a hold.
HOLD_SHARE = 0.1
HEATING, COOLING, HOLD = 1, -1, 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Channel:
    """One accelerometer over its runs, as an error model sees it.

    Attributes
    ----------
    serial : str
    run_ids : tuple of str
        Names of the record's runs 0, 1, ….
    record : Record
        Output and signals in g by `nominal_scale`.
    temp_c, position_deg : ndarray, shape (n,)
        The position is NaN where it was not recorded.
    direction : ndarray of int, shape (n,)
        1 heating, −1 cooling, 0 hold.
    has_input : bool
        False when the specific force is not known: the input is then an unknown constant.
    output_unit : str
    nominal_scale : float
        Output unit per g of the record's output.
    gravity_m_s2 : float
    temp_sigma_c, temp_gain_ppm : float
        What the thermistor may be wrong by, 1 sigma: an offset, and a gain about 0 °C.
    """

    serial: str
    run_ids: tuple[str, ...]
    record: Record
    temp_c: FloatArray
    position_deg: FloatArray
    direction: NDArray[np.int8]
    has_input: bool
    output_unit: str
    nominal_scale: float
    gravity_m_s2: float
    temp_sigma_c: float = 0.0
    temp_gain_ppm: float = 0.0

    def __post_init__(self) -> None:
        freeze(
            self,
            temp_c=readonly(self.temp_c),
            position_deg=readonly(self.position_deg),
            direction=sealed(self.direction.astype(np.int8)),
        )

    def referred(self, k1: float) -> "Channel":
        """Return the same readings in g of a scale factor k1 times this one's."""
        record = self.record
        output = sealed(np.asarray(record.output) / k1)
        scaled = Record(
            time_s=record.time_s, run=record.run, signals=dict(record.signals), output=output
        )
        return replace(self, record=scaled, nominal_scale=self.nominal_scale * k1)

    def runs_mask(self, run_ids: tuple[str, ...]) -> IntArray:
        """Return the readings of some runs, as indices."""
        wanted = [self.run_ids.index(r) for r in run_ids]
        return np.flatnonzero(np.isin(self.record.run, wanted))

    def take(self, rows: IntArray) -> "Channel":
        """Return some readings as a channel of its own."""
        kept: list[int] = np.unique(self.record.run[rows]).tolist()
        return Channel(
            serial=self.serial,
            run_ids=tuple(self.run_ids[r] for r in kept),
            record=self.record.take(rows),
            temp_c=self.temp_c[rows],
            position_deg=self.position_deg[rows],
            direction=self.direction[rows],
            has_input=self.has_input,
            output_unit=self.output_unit,
            nominal_scale=self.nominal_scale,
            gravity_m_s2=self.gravity_m_s2,
            temp_sigma_c=self.temp_sigma_c,
            temp_gain_ppm=self.temp_gain_ppm,
        )


def channel_of(
    runs: RecordedRuns, serial: str, *, t_ref_c: float = 25.0, rows: IntArray | None = None
) -> Channel:
    """Take one accelerometer out of recorded runs.

    Parameters
    ----------
    runs : RecordedRuns
    serial : str
    t_ref_c : float
        Reference temperature, °C.
    rows : ndarray of int, optional
        Which readings, as `rows_of` orders them; default: those without a flag.

    Raises
    ------
    InputError
        If there is no such accelerometer, no good reading of it, or its runs differ in unit,
        gravity or nominal scale.
    """
    chosen = rows_of(runs, serial, runs.good) if rows is None else rows
    if chosen.size == 0:
        raise InputError(runs.source, f"serial {serial}", "every reading is flagged")
    whole = chosen.size == len(runs) and bool(np.all(np.diff(chosen) == 1))
    return _channel(runs if whole else runs.take(chosen), serial, t_ref_c)


def refuse_without_temperature(runs: RecordedRuns, serial: str) -> None:
    """Refuse an accelerometer with a run without any temperature: no model over it can be had.

    Raises
    ------
    InputError
        Naming the run.
    """
    mine = runs.serial.codes == runs.serials.index(serial)
    for code in np.unique(runs.run.codes[mine]).tolist():
        of_run = mine & (runs.run.codes == code)
        if np.all(np.isnan(runs.temp_c[of_run])):
            raise InputError(
                runs.source,
                f"serial {serial} run {runs.run_ids[code]}",
                "temp_c is not recorded: a model over temperature needs it; use accelbench "
                "stability to compare such runs at one temperature",
            )


def rows_of(runs: RecordedRuns, serial: str, mask: BoolArray) -> IntArray:
    """Return the rows of an accelerometer within a mask, run by run.

    Raises
    ------
    InputError
        If there is no such accelerometer.
    """
    if serial not in runs.serials:
        known = ", ".join(runs.serials)
        raise InputError(runs.source, "", f"no serial {serial!r}; expected one of {known}")
    rows = np.flatnonzero(mask & (runs.serial.codes == runs.serials.index(serial)))
    return rows[np.argsort(runs.run.codes[rows], kind="stable")]


def _channel(mine: RecordedRuns, serial: str, t_ref_c: float) -> Channel:
    counts = np.bincount(mine.run.codes)
    present = np.flatnonzero(counts)
    run = sealed((np.cumsum(counts > 0) - 1)[mine.run.codes])
    temp_c = _known_temperature(mine, t_ref_c)
    force = mine.specific_force_g if mine.has_input else None
    i, p, o = (
        constant(0.0, len(mine)) if force is None else _compact(force[:, k]) for k in range(3)
    )
    del force
    at = Conditions(
        time_s=mine.time_s,
        run=run,
        temp_c=temp_c,
        position_deg=mine.position_deg,
        force_g=(i, p, o),
        elapsed_h=sealed(elapsed_h(mine, run)),
        t_ref_c=t_ref_c,
        columns=_recorded(mine),
    )
    made = {name: sealed(values) for name, values in signals_of(at).items()}
    return Channel(
        serial=serial,
        run_ids=tuple(mine.run_ids[int(k)] for k in present),
        record=Record(
            time_s=mine.time_s,
            run=run,
            signals=made,
            output=sealed(mine.output / mine.nominal_scale),
        ),
        temp_c=temp_c,
        position_deg=mine.position_deg,
        direction=direction_of(at.smooth[1]),
        has_input=mine.has_input,
        output_unit=mine.output_unit,
        nominal_scale=mine.nominal_scale,
        gravity_m_s2=mine.gravity_m_s2,
        temp_sigma_c=max(s.temp_sigma_c for s in mine.scales.values()),
        temp_gain_ppm=max(s.temp_gain_ppm for s in mine.scales.values()),
    )


def _known_temperature(mine: RecordedRuns, t_ref_c: float) -> FloatArray:
    """Return the temperatures; where none is recorded, all readings are at the reference's."""
    none = np.isnan(mine.temp_c)
    if not none.any():
        return mine.temp_c
    if not none.all():
        problem = "temp_c is recorded in part of the runs, expected in all of them or none"
        raise InputError(mine.source, "", problem)
    return np.full(len(mine), t_ref_c)


def _recorded(mine: RecordedRuns) -> dict[str, FloatArray]:
    """Return the columns that signals are made of, of those recorded in every reading."""
    found = {"chamber_c": mine.chamber_c, **mine.more}
    return {name: values for name, values in found.items() if not np.isnan(values).any()}


def refuse_without_signals(model: ErrorModel, channel: Channel, source: str) -> None:
    """Refuse a model that needs a signal which was not recorded.

    Raises
    ------
    InputError
        Naming the terms and the column.
    """
    for one in model.terms:
        missing = sorted(one.needs - set(channel.record.signals))
        if missing:
            raise InputError(
                source,
                f"serial {channel.serial}",
                f"{one.name} needs {', '.join(missing)}, which is not recorded in every reading",
            )


def _compact(values: FloatArray) -> FloatArray:
    """Return a copy that takes no room where it is 0 everywhere, as along OA on a head."""
    return sealed(values.copy()) if np.any(values) else constant(0.0, values.size)


def elapsed_h(mine: RecordedRuns, run: IntArray) -> FloatArray:
    """Return the hours since the first run began, shape (n,).

    From the recorded starts when every run has one and none begins before another has ended (as
    in emulated tests, whose hours pass in seconds); otherwise with the runs laid end to end in the
    order of the recording.

    Parameters
    ----------
    mine : RecordedRuns
        One accelerometer's readings, run by run.
    run : ndarray of int, shape (n,)
        Which run, counted from 0.
    """
    ids = [mine.run.at(int(np.argmax(run == k))) for k in range(int(run[-1]) + 1)]
    known = [mine.run_start_utc.get(name) for name in ids]
    starts = [t.timestamp() for t in known if t is not None]
    ends = [float(mine.time_s[run == k].max()) for k in range(len(ids))]
    if len(starts) < len(ids) or _overlapping(starts, ends):
        starts = np.concatenate([[0.0], np.cumsum(ends)[:-1]]).tolist()
    begun = np.array(starts) - min(starts)
    return (begun[run] + mine.time_s) / 3600.0


def _overlapping(starts_s: Sequence[float], lengths_s: Sequence[float]) -> bool:
    """Tell whether a run begins while another goes on: an accelerometer is in one at a time."""
    order = np.argsort(starts_s)
    begun, ended = np.array(starts_s)[order], (np.array(starts_s) + np.array(lengths_s))[order]
    return bool(np.any(begun[1:] < ended[:-1]))


def direction_of(rate_c_per_min: FloatArray) -> NDArray[np.int8]:
    """Tell heating (1), cooling (−1) and hold (0) from the rate of temperature."""
    if not rate_c_per_min.size:
        return np.zeros(0, dtype=np.int8)
    speed = np.abs(rate_c_per_min)
    fastest = float(np.quantile(speed, 0.95))
    # between soaks the temperature may move in fewer readings: then the rate at which half of
    # its way is made, which noise within the soaks hardly adds to
    speed.sort()
    way = np.cumsum(speed)
    half = float(speed[np.searchsorted(way, 0.5 * way[-1])])
    del way, speed
    moving = np.abs(rate_c_per_min) > HOLD_SHARE * max(fastest, half)
    return np.where(moving, np.sign(rate_c_per_min), 0).astype(np.int8)
