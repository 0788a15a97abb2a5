"""The station file: which instruments there are, where, and what they may be told to do.

`StationConfig` is what `station.toml` holds; `drivers.opening.open_station` turns it into devices.
"""

from typing import TYPE_CHECKING, Annotated, Literal, Self, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from drivers.chambers.models import CHAMBER_MODELS
from drivers.devices import CHAMBER_C

if TYPE_CHECKING:
    ChamberName = str
else:
    ChamberName = Literal[tuple(CHAMBER_MODELS)]

FASTEST_C_PER_MIN = 100.0  # screening chambers blown on with liquid nitrogen reach 60 to 70
SLOTS, CHANNELS_IN_SLOT = 3, 20  # of the 34970A and of its multiplexer 34901A
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


Patience = Annotated[float, Field(gt=0, le=60)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class LinkConfig(_Section):
    """Address of an instrument, and the patience with it.

    `url` is ``modbus+tcp://host:port``, ``modbus+rtu:///dev/ttyUSB0``,
    ``modbus+rtu+tcp://host:port`` (RTU frames through a serial server) or
    ``serial:///dev/ttyUSB0``.
    """

    url: str
    unit_id: Annotated[int, Field(ge=0, le=247)] = 1
    baud: Annotated[int, Field(gt=0)] = 9600
    # an answer takes a fraction of a second; who waits longer than a minute watches nothing
    timeout_s: Patience = 1.0
    retries: Annotated[int, Field(ge=0, le=10)] = 2


def _of_schemes(*schemes: str) -> AfterValidator:
    """Return a check that a URL begins with one of these schemes."""

    def check(url: str) -> str:
        if url.partition("://")[0] not in schemes:
            raise ValueError(f"url {url!r}: expected {', '.join(s + '://…' for s in schemes)}")
        return url

    return AfterValidator(check)


ModbusUrl = Annotated[str, _of_schemes("modbus+tcp", "modbus+rtu", "modbus+rtu+tcp")]
SerialUrl = Annotated[str, _of_schemes("serial", "socket")]


class ChamberConfig(LinkConfig):
    """A chamber, its limits and its safe condition.

    `confirmed` holds, in words, what no register of the controller shows and somebody compared
    with its display; the driver says what to write there.
    """

    url: ModbusUrl
    model: ChamberName
    limits_c: tuple[Finite, Finite] = (-55.0, 85.0)
    rate_limits_c_per_min: tuple[Positive, Positive] = (0.05, 5.0)
    safe_temp_c: Finite = 25.0
    decimals: Annotated[int, Field(ge=0, le=3)] = 1  # integer scaling of the controller
    word_order: Literal["low", "high"] = "low"  # which half of a float the controller sends first
    confirmed: str | None = None

    @model_validator(mode="after")
    def _check(self) -> "ChamberConfig":
        if not self.limits_c[0] < self.limits_c[1]:
            raise ValueError("limits_c must be [low, high] with low below high")
        if not all(limit in CHAMBER_C for limit in self.limits_c):
            raise ValueError(
                f"limits_c must lie within {CHAMBER_C.lo:g} to {CHAMBER_C.hi:g} °C, "
                "beyond which there are no chambers"
            )
        if not self.rate_limits_c_per_min[0] < self.rate_limits_c_per_min[1]:
            raise ValueError("rate_limits_c_per_min must be [low, high] with low below high")
        if self.rate_limits_c_per_min[1] > FASTEST_C_PER_MIN:
            raise ValueError(
                f"rate_limits_c_per_min must not exceed {FASTEST_C_PER_MIN:g} °C/min, "
                "more than any chamber does"
            )
        if not self.limits_c[0] <= self.safe_temp_c <= self.limits_c[1]:
            raise ValueError("safe_temp_c must lie inside limits_c")
        return self


class DigitiserConfig(LinkConfig):
    """A scanning multimeter."""

    url: SerialUrl
    model: Literal["keysight_34970a"] = "keysight_34970a"
    nplc: Positive = 1.0
    timeout_s: Patience = 10.0


class HeadConfig(LinkConfig):
    """An indexing head on a motion controller."""

    url: SerialUrl
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


def _existing(channel: int) -> int:
    """Return a channel that measures voltage and resistance, or refuse."""
    slot, number = divmod(channel, 100)
    if not (1 <= slot <= SLOTS and 1 <= number <= CHANNELS_IN_SLOT):
        raise ValueError(f"channel {channel}: expected 101 to 120, 201 to 220 or 301 to 320")
    return channel


Channel = Annotated[int, AfterValidator(_existing)]


class InputConfig(_Section):
    """Wiring of one accelerometer: its output and its own thermistor."""

    serial: Annotated[str, Field(min_length=1)]
    output_channel: Channel
    thermistor_channel: Channel
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
    "setpoint_changed",  # somebody sets another set point at the chamber's panel
    "loop_off",  # somebody switches the chamber's loop off, or to manual where it has no off
    "foreign_profile",  # somebody starts a profile or program of his own at the chamber
]
PanelAction = Literal["setpoint_changed", "loop_off", "foreign_profile"]


class SignalConfig(_Section):
    """A signal of the whole station that is recorded beside the accelerometers: V on a channel."""

    name: str
    channel: Channel


class FaultConfig(_Section):
    """A misbehaviour of an emulated instrument, planned in emulated time."""

    device: Literal["chamber", "digitiser", "head"]
    kind: FaultKind
    at_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]  # after the emulator started
    count: Annotated[int, Field(ge=1)] = 1  # replies it spoils, for the kinds that spoil replies
    duration_s: Positive | None = None  # how long a state lasts; None: until the end
    temp_c: Finite | None = None  # the set point of what somebody does; None: the emulator's choice

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind in get_args(PanelAction) and self.device != "chamber":
            raise ValueError(f"{self.kind} happens to the chamber, not to the {self.device}")
        return self


class EmulationConfig(_Section):
    """For emulated instruments: how fast time runs, what goes wrong, and with what luck."""

    speed: Positive = 1.0  # multiple of real time; ignored where a stepped clock is used
    seed: Annotated[int, Field(ge=0)] = 1
    faults: tuple[FaultConfig, ...] = ()


class GuardianConfig(_Section):
    """The second process that makes the chamber safe when the controller is dead or silent.

    It acts when the controller is silent for longer than its longest legal step, which follows
    from the time-outs and retries above (`thermo.planning.silence`), and this margin.
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
    signals: tuple[SignalConfig, ...] = ()
    on_foreign_change: Literal["end", "pause", "tell"] = "end"
    guardian: GuardianConfig = GuardianConfig()
    emulation: EmulationConfig | None = None

    @model_validator(mode="after")
    def _check(self) -> "StationConfig":
        channels = [c for i in self.inputs for c in (i.output_channel, i.thermistor_channel)]
        channels += [s.channel for s in self.signals]
        if len(set(channels)) != len(channels):
            raise ValueError("inputs: a digitiser channel is used twice")
        names = [s.name for s in self.signals]
        if len(set(names)) != len(names):
            raise ValueError("signals: a name is listed twice")
        serials = [i.serial for i in self.inputs]
        if len(set(serials)) != len(serials):
            raise ValueError("inputs: a serial number is listed twice")
        model = self.chamber.model
        for fault in self.emulation.faults if self.emulation is not None else ():
            if fault.kind in CHAMBER_MODELS[model].hidden:
                problem = f"a {model} has no register that tells {fault.kind}"
                raise ValueError(f"emulation.faults: {problem}")
        return self

    @property
    def signal_channels(self) -> dict[str, int]:
        """The channels of recorded signals by the signal's name."""
        return {s.name: s.channel for s in self.signals}
