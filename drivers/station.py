"""The station file: which instruments there are, where, and what they may be told to do.

`StationConfig` is what `station.toml` holds; `drivers.opening.open_station` turns it into devices.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class LinkConfig(_Section):
    """How an instrument is reached.

    `url` is ``modbus+tcp://host:port``, ``modbus+rtu:///dev/ttyUSB0``,
    ``modbus+rtu+tcp://host:port`` (RTU frames through a serial server) or
    ``serial:///dev/ttyUSB0``.
    """

    url: str
    unit_id: Annotated[int, Field(ge=0, le=247)] = 1
    baud: Annotated[int, Field(gt=0)] = 9600
    timeout_s: Positive = 1.0
    retries: Annotated[int, Field(ge=0, le=10)] = 2


class ChamberConfig(LinkConfig):
    """A chamber, its limits and its safe condition."""

    model: Literal["watlow_f4t", "watlow_f4", "eurotherm_3504"]
    limits_c: tuple[Finite, Finite] = (-55.0, 85.0)
    rate_limits_c_per_min: tuple[Positive, Positive] = (0.05, 5.0)
    safe_temp_c: Finite = 25.0
    decimals: Annotated[int, Field(ge=0, le=3)] = 1  # integer scaling of the controller

    @model_validator(mode="after")
    def _check(self) -> "ChamberConfig":
        if not self.limits_c[0] < self.limits_c[1]:
            raise ValueError("limits_c must be [low, high] with low below high")
        if not self.rate_limits_c_per_min[0] < self.rate_limits_c_per_min[1]:
            raise ValueError("rate_limits_c_per_min must be [low, high] with low below high")
        if not self.limits_c[0] <= self.safe_temp_c <= self.limits_c[1]:
            raise ValueError("safe_temp_c must lie inside limits_c")
        return self


class DigitiserConfig(LinkConfig):
    """A scanning multimeter."""

    model: Literal["keysight_34970a"] = "keysight_34970a"
    nplc: Positive = 1.0
    timeout_s: Positive = 10.0


class HeadConfig(LinkConfig):
    """An indexing head on a motion controller."""

    model: Literal["newport_esp301"] = "newport_esp301"
    axis: Annotated[int, Field(ge=1, le=3)] = 1
    limits_deg: tuple[Finite, Finite] = (-360.0, 360.0)
    speed_deg_per_s: Positive = 20.0
    baud: Annotated[int, Field(gt=0)] = 19200

    @model_validator(mode="after")
    def _check(self) -> "HeadConfig":
        if not self.limits_deg[0] < self.limits_deg[1]:
            raise ValueError("limits_deg must be [low, high] with low below high")
        return self


class ThermistorConfig(_Section):
    """Steinhart-Hart coefficients: 1/T = a + b ln R + c (ln R)³, T in kelvin, R in ohm.

    The defaults are a common 10 kΩ (at 25 °C) curve, 3977 K type.
    """

    a: Finite = 1.129148e-3
    b: Positive = 2.34125e-4
    c: Finite = 8.76741e-8


class InputConfig(_Section):
    """Where one accelerometer is wired: its output and its own thermistor."""

    serial: Annotated[str, Field(min_length=1)]
    output_channel: Annotated[int, Field(ge=101, le=399)]
    thermistor_channel: Annotated[int, Field(ge=101, le=399)]
    output_unit: Literal["mA", "V"] = "mA"
    load_ohm: Positive = 1000.0  # turns the output current into the voltage that is measured
    full_scale_v: Positive = 10.0
    thermistor: ThermistorConfig = ThermistorConfig()


FaultKind = Literal[
    "silence",  # no reply at all
    "late_reply",  # the reply comes after the asker gave up
    "exception",  # Modbus exception code; an error in the SCPI or ESP301 queue
    "broken_crc",  # RTU: wrong CRC; TCP: wrong transaction id; serial: garbled line
    "split_frame",  # the reply comes in two pieces with a pause between
    "dropped_connection",
    "stuck_temperature",  # the chamber's reading no longer moves
    "sensor_break",
    "over_temperature",  # the chamber runs away and its limit trips
]


class FaultConfig(_Section):
    """A misbehaviour of an emulated instrument, planned in emulated time."""

    device: Literal["chamber", "digitiser", "head"]
    kind: FaultKind
    at_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]  # after the emulator started
    count: Annotated[int, Field(ge=1)] = 1  # replies it spoils, for the kinds that spoil replies
    duration_s: Positive | None = None  # how long a state lasts; None: until the end


class EmulationConfig(_Section):
    """For emulated instruments: how fast time runs, what goes wrong, and with what luck."""

    speed: Positive = 1.0  # multiple of real time; ignored where a stepped clock is used
    seed: Annotated[int, Field(ge=0)] = 1
    faults: tuple[FaultConfig, ...] = ()


class GuardianConfig(_Section):
    """The second process that makes the chamber safe when the controller is dead or silent.

    It acts when the controller is silent for longer than its longest legal step, which follows
    from the time-outs and retries above (`thermo.heartbeat.longest_step_s`), and this margin.
    """

    # for what is computed between two questions (the verdict on a ramp, the decision on a run-in)
    # and a loaded machine; a chamber at 5 °C/min moves 2.5 °C in it
    margin_s: Positive = 30.0


class StationConfig(_Section):
    """A whole station."""

    name: str = "station"
    gravity_m_s2: Annotated[float, Field(gt=9.7, lt=9.9)] = 9.80665
    chamber: ChamberConfig
    digitiser: DigitiserConfig
    head: HeadConfig
    inputs: Annotated[tuple[InputConfig, ...], Field(min_length=1)]
    guardian: GuardianConfig = GuardianConfig()
    emulation: EmulationConfig | None = None

    @model_validator(mode="after")
    def _check(self) -> "StationConfig":
        channels = [c for i in self.inputs for c in (i.output_channel, i.thermistor_channel)]
        if len(set(channels)) != len(channels):
            raise ValueError("inputs: a digitiser channel is used twice")
        serials = [i.serial for i in self.inputs]
        if len(set(serials)) != len(serials):
            raise ValueError("inputs: a serial number stands twice")
        return self
