"""Checks of the runs of an accelerometer before a search."""

import numpy as np

from errormodel.errors import InputError
from thermo.library.head import MAX_MOUNTINGS
from thermo.library.passing import MAX_RUNS
from thermo.recording.channel import Channel
from thermo.recording.units_check import SCALE_RANGE

MOVING_G = 0.1  # an input that changes less does not determine the scale
LEAST_READINGS = 200
# Fewer readings in a run determine neither its noise nor its repeatable part.
LEAST_IN_RUN = 30
# Noise alone has a ratio of one; chamber ripple slower than the readings has a larger ratio.
MOVED = 1.5


def check_channel(channel: Channel, source: str) -> None:
    """Check that one accelerometer's runs can be searched.

    Parameters
    ----------
    channel : Channel
    source : str
        Files they came from, for messages.

    Raises
    ------
    InputError
        If there are too few readings, too many runs or mountings, or they show nothing over
        temperature. Units and signs are checked when the readings are read
        (`thermo.recording.units_check`).
    """

    def refused(problem: str) -> InputError:
        return InputError(source, f"serial {channel.serial}", problem)

    record, runs = channel.record, len(channel.run_ids)
    if len(record) < LEAST_READINGS:
        raise refused(f"{len(record)} readings, at least {LEAST_READINGS} expected")
    counts = np.bincount(record.run)
    if counts.min() < LEAST_IN_RUN:
        name = channel.run_ids[int(np.argmin(counts))]
        problem = f"run {name} has {counts.min()} readings, at least {LEAST_IN_RUN} expected"
        raise refused(f"{problem}; leave it out")
    if runs > MAX_RUNS:
        raise refused(f"{runs} runs, at most {MAX_RUNS} expected; give some of them")
    for name, readings in zip(channel.run_ids, record.run_slices, strict=True):
        if np.ptp(record["mounting"][readings]) > 0:
            raise refused(f"run {name}: a_i_g and a_p_g do not agree with position_deg")
    mountings = int(record["mounting"].max()) + 1
    if mountings > MAX_MOUNTINGS:
        raise refused(f"{mountings} mountings, at most {MAX_MOUNTINGS} expected")
    spread_c, noise_c = _temperature(channel)
    if not spread_c > MOVED * noise_c:
        raise refused(
            f"the temperature does not change by more than its noise of {noise_c:.2g} °C; for "
            f"one temperature use `fit`, which gives the constants"
        )
    output = np.asarray(record.output)
    if np.ptp(output) == 0.0:
        raise refused(f"every output is {output[0] * channel.nominal_scale:g}, expected readings")


def in_own_scale(channel: Channel) -> Channel:
    """Return a channel rescaled to its measured output per g, if the nominal scale is far from it.

    Such units are refused at reading unless the user trusts them. Otherwise all sizes in µg would
    be wrong by the same factor.
    """
    force = channel.record["a_i_g"]
    if not channel.has_input or np.std(force) < MOVING_G:
        return channel
    gain = float(np.polyfit(force, np.asarray(channel.record.output), 1)[0])
    return channel if SCALE_RANGE[0] <= gain <= SCALE_RANGE[1] else channel.referred(gain)


def _temperature(channel: Channel) -> tuple[float, float]:
    """Return the standard deviation of the temperature, and that of its noise alone, °C.

    The noise is computed from the differences of consecutive readings (von Neumann's ratio).
    """
    steps = np.diff(channel.temp_c)[np.diff(channel.record.run) == 0]
    return float(np.std(channel.temp_c)), float(np.sqrt(np.mean(steps**2) / 2.0))
