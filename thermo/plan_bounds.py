"""How wide a limit may be: one that would protect nobody is refused before a test begins."""

from drivers.station import StationConfig
from thermo.heartbeat import silence_limit_s
from thermo.sequence import Sequence

PLAUSIBLE_C = (-120.0, 200.0)  # a thermistor that shows more is open, shorted or not connected

# of a controller, before its guardian acts: in half an hour at 5 °C/min a chamber crosses all its
# range, and none of the time-outs of the examples needs a quarter of it
MOST_SILENCE_S = 1800.0

# key: least, most, and why
BOUNDS: dict[str, tuple[float, float, str]] = {
    "limits.max_deviation_c": (
        0.0,
        30.0,
        "on its fastest ramp, 5 °C/min at a lag of 5 min, a chamber is 25 °C behind",
    ),
    "limits.max_deviation_min": (
        0.0,
        120.0,
        "in two hours a chamber can run anywhere",
    ),
    "limits.stuck_c": (0.0, 30.0, "a reading that stands still is to be seen before it deviates"),
    "limits.max_failures": (1, 1000, "looks at the chamber are some 10 s apart"),
    "limits.max_failure_s": (0.0, 3600.0, "without readings nothing is limited"),
    "temperature.start_timeout_min": (
        0.0,
        2880.0,
        "at 0.05 °C/min two days are enough for 140 °C",
    ),
    "temperature.approach_c_per_min": (
        0.05,
        100.0,
        "a slower one would excuse a deviation for hours after every step",
    ),
    "after_gap.max_gap_s": (0.0, 86_400.0, "after a day it is another test"),
}


def unprotecting(sequence: Sequence) -> tuple[str, str] | None:
    """Find the first limit of a sequence that would protect nobody.

    Parameters
    ----------
    sequence : Sequence

    Returns
    -------
    tuple of str, or None
        The key, and what is wrong with its value.
    """
    for key, (least, most, why) in BOUNDS.items():
        section, name = key.split(".")
        value = float(getattr(getattr(sequence, section), name))
        if not least <= value <= most:
            return key, f"{value:g}, expected {least:g}…{most:g}: {why}"
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
        f"with it and the station's time-outs and retries a silent controller would be relieved "
        f"after {silence_s:.4g} s, {MOST_SILENCE_S:g} s expected at most",
    )
