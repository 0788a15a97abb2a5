"""Bounds of the numbers in sequence and station file, checked before a test begins.

A limit may not be so wide that it would protect nobody, and no number may be one that no
instrument, accelerometer or laboratory has. Where the file's own check bounds a number on both
sides, nothing stands here.
"""

from collections.abc import Iterator
from typing import cast

from pydantic import BaseModel

from drivers.devices import CHAMBER_C
from drivers.station import StationConfig
from thermo.planning.sequence import Sequence
from thermo.planning.silence import silence_limit_s

PLAUSIBLE_C = (-120.0, 200.0)  # a thermistor that shows more is open, shorted or not connected

# of a controller, before its guardian acts: in half an hour at 5 °C/min a chamber crosses all its
# range, and none of the time-outs of the examples needs a quarter of it
MOST_SILENCE_S = 1800.0

Bounds = dict[str, tuple[float, float, str]]

# key, without the numbers of list elements: least, most, and why
SEQUENCE: Bounds = {
    "limits.max_deviation_c": (
        0.0,
        30.0,
        "on its fastest ramp, 5 °C/min at a lag of 5 min, a chamber is 25 °C behind",
    ),
    "limits.max_deviation_min": (
        0.0,
        120.0,
        "in two hours a chamber can reach any temperature",
    ),
    "limits.stuck_c": (0.0, 30.0, "a stuck reading must be detected before it deviates"),
    "limits.max_failures": (1, 1000, "checks of the chamber are some 10 s apart"),
    "limits.max_failure_s": (0.0, 3600.0, "without readings no limit protects"),
    "temperature.start_timeout_min": (
        0.0,
        2880.0,
        "at 0.05 °C/min two days are enough for 140 °C",
    ),
    "temperature.approach_c_per_min": (
        0.05,
        100.0,
        "a slower rate would permit a deviation for hours after every step",
    ),
    "after_gap.max_gap_s": (0.0, 86_400.0, "after a day it is another test"),
    "accelerometers.nominal_scale": (
        1e-6,
        1e4,
        "mA or V per g: a microampere or microvolt to ten amperes or kilovolts",
    ),
    "uniformity.band_c_per_min": (0.0, 100.0, "no chamber is faster"),
    "uniformity.transient_min": (0.0, 1440.0, "no case takes longer than a day to follow"),
    "uniformity.sins_self_heating.time_min": (-1e5, 1e5, "within seventy days of power-on"),
    "run_in.k0_limit_ug": (1e-3, 1e6, "a nano-g to one g"),
    "run_in.k1_limit_ppm": (1e-3, 1e6, "a billionth to the full value"),
}

_BAUD = (110, 4_000_000, "no serial line is slower or faster")
STATION: Bounds = {
    "chamber.baud": _BAUD,
    "digitiser.baud": _BAUD,
    "head.baud": _BAUD,
    "digitiser.nplc": (0.02, 200.0, "what the 34970A can integrate over"),
    "head.limits_deg": (-3600.0, 3600.0, "ten turns wind up any cable"),
    "head.speed_deg_per_s": (0.01, 3600.0, "an hour for 36°, or ten turns a second"),
    "inputs.load_ohm": (0.01, 1e7, "the multimeter's own 10 MΩ lie across it"),
    "inputs.full_scale_v": (1e-3, 300.0, "the multimeter's ranges end at 300 V"),
    # of thermistors from 100 Ω to 1 MΩ at 25 °C, all within a third of this
    "inputs.thermistor.a": (-0.01, 0.01, "1/T is 0.0034 at 25 °C"),
    "inputs.thermistor.b": (1e-5, 1e-3, "1/T changes by this with ln R: 1000 to 100 000 K"),
    "inputs.thermistor.c": (-1e-5, 1e-5, "some 1e-7 in any thermistor"),
    "emulation.speed": (1e-3, 1e6, "slower is too slow to wait for, faster is not possible"),
    "emulation.faults.at_s": (0.0, 1e8, "after three years no test runs"),
    "emulation.faults.count": (1, 1_000_000, "no test asks for more replies"),
    "emulation.faults.duration_s": (0.0, 1e8, "no test lasts three years"),
    "emulation.faults.temp_c": (CHAMBER_C.lo, CHAMBER_C.hi, "there are no other chambers"),
}


def _numbers(data: object, key: str = "", place: str = "") -> Iterator[tuple[str, str, float]]:
    """Yield the key of every number, the place of it with its list's index, and the number."""
    if isinstance(data, dict):
        for name, value in cast(dict[str, object], data).items():
            yield from _numbers(value, f"{key}.{name}", f"{place}.{name}")
    elif isinstance(data, list | tuple):
        for index, value in enumerate(cast(list[object], data)):
            yield from _numbers(value, key, f"{place}.{index}")
    elif isinstance(data, int | float) and not isinstance(data, bool):
        yield key.removeprefix("."), place.removeprefix("."), data


def beyond(config: BaseModel, bounds: Bounds) -> tuple[str, str] | None:
    """Find the first number of a file that nothing can have, or that would protect nobody.

    Parameters
    ----------
    config : pydantic.BaseModel
        What the file holds.
    bounds : mapping
        `SEQUENCE` or `STATION`.

    Returns
    -------
    tuple of str, or None
        The key, and what is wrong with its value.
    """
    for key, place, value in _numbers(config.model_dump()):
        if key in bounds:
            least, most, why = bounds[key]
            if not least <= value <= most:
                return place, f"{value:g}, expected {least:g}…{most:g}: {why}"
    return None


def unprotecting(sequence: Sequence) -> tuple[str, str] | None:
    """Find out whether a sequence's limits of the accelerometers would protect nobody.

    Parameters
    ----------
    sequence : Sequence

    Returns
    -------
    tuple of str, or None
        The key, and what is wrong with its value.
    """
    low, high = sequence.limits.accelerometer_c or PLAUSIBLE_C
    least, most = PLAUSIBLE_C
    if low < least or high > most:
        return (
            "limits.accelerometer_c",
            f"{low:g}…{high:g} °C, expected within {least:g}…{most:g} °C: a thermistor that shows "
            "more counts as lost",
        )
    return None


def unguarded(station: StationConfig) -> tuple[str, str] | None:
    """Find out whether a station's time-outs would let its guardian sleep for too long.

    Parameters
    ----------
    station : StationConfig

    Returns
    -------
    tuple of str, or None
        The key, and what is wrong with its value.
    """
    silence_s = silence_limit_s(station)
    if silence_s <= MOST_SILENCE_S:
        return None
    return (
        "guardian.margin_s",
        f"with this value and the time-outs and retries of the station, the guardian would act "
        f"only after {silence_s:.4g} s, {MOST_SILENCE_S:g} s expected at most",
    )
