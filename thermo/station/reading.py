"""Conversion of a scan of the digitiser into rows of the store; bad values are left empty."""

import math
from collections.abc import Mapping, Sequence

from drivers.devices import ChannelReading, ScanChannel
from drivers.digitisers.thermistor import temp_c_from_ohm
from drivers.station import InputConfig, StationConfig
from thermo.planning.bounds import PLAUSIBLE_C
from thermo.planning.sequence import Sequence as TestSequence
from thermo.store.records import ReadingRow

MA_PER_A = 1000.0


def inputs_of(sequence: TestSequence, station: StationConfig) -> tuple[InputConfig, ...]:
    """Return the wiring of the accelerometers under test, in the sequence's order."""
    wired = {entry.serial: entry for entry in station.inputs}
    return tuple(wired[a.serial] for a in sequence.accelerometers)


def scan_channels(
    inputs: Sequence[InputConfig], signals: Mapping[str, int]
) -> tuple[ScanChannel, ...]:
    """Return the scan list: each output, then its thermistor, and last the recorded signals.

    A thermistor's resistance changes hundredfold over a chamber's range: on the range for the cold
    end, the error of the meter at the hot end would be 0.1 °C and more. The channel is therefore
    autoranged.
    """
    channels: list[ScanChannel] = []
    for entry in inputs:
        channels += [
            ScanChannel(
                number=entry.output_channel, quantity="voltage", full_scale=entry.full_scale_v
            ),
            ScanChannel(
                number=entry.thermistor_channel, quantity="resistance", full_scale=math.inf
            ),
        ]
    channels += [
        ScanChannel(number=number, quantity="voltage", full_scale=math.inf)
        for number in signals.values()
    ]
    return tuple(channels)


def output_of(volt: float, entry: InputConfig) -> float:
    """Turn a measured voltage into the accelerometer's output in its own unit."""
    return volt / entry.load_ohm * MA_PER_A if entry.output_unit == "mA" else volt


def make_rows(
    scan: Sequence[ChannelReading],
    inputs: Sequence[InputConfig],
    *,
    slot: int,
    attempt: int,
    segment: int,
    scan_s: float,
    position_deg: float | None,
    chamber_c: float | None,
    lateness_s: float,
    flags: Sequence[str] = (),
    signals: Mapping[str, int] | None = None,
) -> tuple[ReadingRow, ...]:
    """Make one row per accelerometer out of a scan.

    Parameters
    ----------
    scan : sequence of ChannelReading
    inputs : sequence of InputConfig
    slot, attempt, segment : int
        Place of the scan in the plan; `attempt` is that of the segment, 1 for the first.
    scan_s : float
        When the scan began, s from the run's start.
    position_deg : float or None
        Angle read back, °; None if the head was turning.
    chamber_c : float or None
        °C; None when it could not be read.
    lateness_s : float
        Lateness of the scan, s.
    flags : sequence of str
        Faults of the whole scan.
    signals : mapping of str to int, optional
        Channels of the recorded signals, by name; a missing one flags all rows.

    Returns
    -------
    tuple of ReadingRow
        An output or temperature that was not measured is None and its row flagged.
    """
    by_channel = {reading.channel: reading for reading in scan}
    read = {name: by_channel.get(number) for name, number in (signals or {}).items()}
    recorded = {
        name: one.value if one is not None and one.ok and math.isfinite(one.value) else None
        for name, one in read.items()
    }
    flags = [*flags, *(name for name, value in recorded.items() if value is None)]
    rows: list[ReadingRow] = []
    for entry in inputs:
        own = list(flags)
        out, resistor = (
            by_channel.get(number) for number in (entry.output_channel, entry.thermistor_channel)
        )
        output: float | None = None
        if out is not None and out.ok and math.isfinite(out.value):
            output = output_of(out.value, entry)
        else:
            own.append("overload")
        temp_c = _temp_c(resistor, entry)
        if temp_c is None:
            own.append("thermistor")
        offset_s = out.offset_s if out is not None and math.isfinite(out.offset_s) else 0.0
        rows.append(
            ReadingRow(
                serial=entry.serial,
                slot=slot,
                attempt=attempt,
                segment=segment,
                time_s=scan_s + offset_s,
                temp_c=temp_c,
                position_deg=position_deg,
                output=output,
                chamber_c=chamber_c,
                lateness_s=lateness_s,
                flag="+".join(own),
                signals=recorded,
            )
        )
    return tuple(rows)


def _temp_c(reading: ChannelReading | None, entry: InputConfig) -> float | None:
    if reading is None or not reading.ok:
        return None
    temp_c = float(temp_c_from_ohm(reading.value, entry.thermistor))
    return temp_c if PLAUSIBLE_C[0] <= temp_c <= PLAUSIBLE_C[1] else None
