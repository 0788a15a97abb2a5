"""The emulated station that a sequence runs on when no station file is given."""

from drivers.station import (
    ChamberConfig,
    DigitiserConfig,
    HeadConfig,
    InputConfig,
    SignalConfig,
    StationConfig,
)
from errormodel.errors import InputError
from thermo.planning.sequence import Sequence
from thermo.recording.signals import recorded_signals

# the emulated multimeter has three modules of 20 channels: outputs on the first, thermistors on
# the second, and the third shared by both
MAX_EMULATED = 30
LAST_OUTPUT = 310


def default_station(sequence: Sequence) -> StationConfig:
    """Return the emulated station a sequence runs on when none is given.

    A Watlow F4T over TCP on a free port, multimeter and head on pseudo-terminals, and the
    accelerometers wired in the sequence's order: outputs in mA over 1 kΩ on channels 101 to 120 and
    301 to 310, thermistors on 201 to 220 and 311 to 320; recorded signals from 310 downwards.

    Raises
    ------
    InputError
        If there are more accelerometers than the emulated multimeter has channels for.
    """
    recorded = [one.name for one in recorded_signals() if one.emulated is not None]
    most = MAX_EMULATED - len(recorded)
    if len(sequence.accelerometers) > most:
        problem = f"{len(sequence.accelerometers)} are too many to emulate, at most {most}"
        raise InputError(sequence.name, "accelerometers", problem)
    inputs = tuple(
        InputConfig(
            serial=a.serial,
            output_channel=101 + k if k < 20 else 281 + k,
            thermistor_channel=201 + k if k < 20 else 291 + k,
        )
        for k, a in enumerate(sequence.accelerometers)
    )
    return StationConfig(
        name="emulated",
        chamber=ChamberConfig(model="watlow_f4t", url="modbus+tcp://127.0.0.1:0"),
        digitiser=DigitiserConfig(url="serial://auto"),
        head=HeadConfig(url="serial://auto", speed_deg_per_s=40.0),
        inputs=inputs,
        signals=tuple(
            SignalConfig(name=name, channel=LAST_OUTPUT - k) for k, name in enumerate(recorded)
        ),
    )
