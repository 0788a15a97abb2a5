import math

import pytest

from drivers.clock import SteppedClock
from drivers.devices import ScanChannel
from drivers.digitisers.keysight_34970a import ScanningMultimeter
from drivers.digitisers.keysight_34970a_scpi import configuration, range_for
from drivers.errors import DeviceError, LimitError, LinkError
from drivers.station import DigitiserConfig
from tests.drivers.digitisers.keysight_cases import (
    CHANNELS,
    IDENTITY,
    NO_ERROR,
    OHM,
    VOLT,
    check_scan,
    satisfies,
)

# ---- bytes


def test_transcript(transcript):
    steps = [
        (b"*IDN?\n", IDENTITY),  # into step
        (b"SYST:ERR?\n", NO_ERROR),
    ]
    for command in (
        b"SYST:REM",
        b"*RST",
        b"*CLS",
        b"CONF:VOLT:DC 10,(@101,102)",
        b"SENS:VOLT:DC:NPLC 2,(@101,102)",
        b"CONF:RES 1e+06,(@111)",
        b"SENS:RES:NPLC 2,(@111)",
        b"FORM:READ:CHAN ON",
        b"FORM:READ:TIME ON",
        b"FORM:READ:TIME:TYPE REL",
        b"FORM:READ:UNIT OFF",
        b"TRIG:SOUR IMM",
        b"TRIG:COUN 1",
        b"ROUT:SCAN (@101,102,111)",
    ):
        steps += [(command + b"\n", b""), (b"SYST:ERR?\n", NO_ERROR)]
    reply = (
        b"+1.25000000E+00,000000000.040,101,-3.50000000E-03,000000000.080,102,"
        b"+9.90000000E+37,000000000.120,111\r\n"
    )
    steps += [(b"READ?\n", reply), (b"SYST:ERR?\n", NO_ERROR)]
    wire = transcript(steps)
    meter = ScanningMultimeter(
        DigitiserConfig(url=wire.url, timeout_s=2.0), clock=SteppedClock(5.0)
    )
    second = ScanChannel(number=102, quantity="voltage", full_scale=10.0)
    meter.configure([second, OHM, VOLT], nplc=2.0)
    readings = meter.scan()
    meter.close()
    wire.finish()
    assert [(r.channel, r.offset_s, r.ok) for r in readings] == [
        (102, 0.08, True),
        (111, 0.12, False),
        (101, 0.04, True),
    ]
    assert readings[0].value == -3.5e-3
    assert math.isnan(readings[1].value)
    assert meter.counters.retries == 0


# ---- configuring


def test_an_infinite_full_scale_is_autorange():
    thermistor = ScanChannel(number=111, quantity="resistance", full_scale=math.inf)
    assert "CONF:RES AUTO,(@111)" in configuration([thermistor], 1.0)


def test_the_smallest_range_that_holds_the_full_scale_is_taken():
    volts = [0.05, 0.1, 0.2, 5.0, 10.0, 11.0, 300.0]
    made = [ScanChannel(number=101, quantity="voltage", full_scale=v) for v in volts]
    assert [range_for(c) for c in made] == [0.1, 0.1, 1.0, 10.0, 10.0, 100.0, 300.0]


@pytest.mark.parametrize(
    ("channels", "nplc"),
    [
        ([], 1.0),
        ([VOLT, VOLT], 1.0),
        ([VOLT], 0.5),
        ([VOLT], math.nan),
        ([ScanChannel(number=101, quantity="voltage", full_scale=301.0)], 1.0),
        ([ScanChannel(number=101, quantity="voltage", full_scale=math.nan)], 1.0),
        ([ScanChannel(number=101, quantity="resistance", full_scale=0.0)], 1.0),
        ([ScanChannel(number=101, quantity="charge", full_scale=1.0)], 1.0),
    ],
)
def test_what_cannot_be_measured_is_refused_before_a_byte(scripted, channels, nplc):
    port = scripted({})
    meter = ScanningMultimeter(DigitiserConfig(url=port.url, timeout_s=0.1))
    with pytest.raises(LimitError):
        meter.configure(channels, nplc=nplc)
    meter.close()
    assert port.sent == []


def test_fields_are_switched_on_after_the_configuration_switched_them_off():
    commands = configuration([VOLT, OHM], 1.0)
    last_conf = max(i for i, c in enumerate(commands) if c.startswith("CONF"))
    assert all(i > last_conf for i, c in enumerate(commands) if c.startswith("FORM"))
    assert commands[-1] == "ROUT:SCAN (@101,111)"


def test_a_refused_command_names_itself(multimeter):
    meter = multimeter.open()
    beyond = ScanChannel(number=150, quantity="voltage", full_scale=10.0)
    with pytest.raises(DeviceError, match=r"CONF:VOLT:DC 10,\(@150\).*-222"):
        meter.configure([beyond])
    with pytest.raises(DeviceError, match="configure it first"):
        meter.scan()


def test_another_instrument_is_recognised(scripted):
    port = scripted({"*IDN?": ["KEITHLEY,2700,1,B01"], "SYST:ERR?": ['+0,"No error"']})
    meter = ScanningMultimeter(DigitiserConfig(url=port.url, timeout_s=2.0))
    with pytest.raises(DeviceError, match="is a 2700, expected a 34970A"):
        meter.identify()
    meter.close()


@pytest.mark.parametrize(
    ("value", "offset", "overload"),
    [
        ("+1.50000000E+00", "000000000.040", "+9.9E+37"),
        ("1.5", "0.04", "+9.90000000E+37"),
        ("+1.5000000000E+00", "+4.00000000E-02", "9.9E37"),
    ],
)
def test_numbers_as_others_write_them(scripted, value, offset, overload):
    port = scripted(
        {
            "*IDN?": ["HEWLETT-PACKARD,34970A,0,13-2-2"],
            "SYST:ERR?": ['+0,"No error"'],
            "READ?": [f"{value},{offset},101,{overload},{offset},111"],
        }
    )
    clock = SteppedClock()
    meter = ScanningMultimeter(DigitiserConfig(url=port.url, timeout_s=2.0), clock=clock)
    meter.configure([VOLT, OHM])
    for _ in range(2):
        good, open_input = meter.scan()
        assert (good.value, good.offset_s, good.ok) == (1.5, 0.04, True)
        assert math.isnan(open_input.value)
        assert not open_input.ok
    assert meter.counters.retries == 0
    meter.close()


# ---- conformance


def test_conforms(multimeter):
    meter = satisfies(multimeter.open(timeout_s=2.0))
    assert "34970A" in meter.identify()
    meter.configure(CHANNELS, nplc=1.0)
    check_scan(multimeter, meter.scan())
    multimeter.wait(60.0)
    readings = meter.scan()
    check_scan(multimeter, readings)
    # ascending order: 101, 111, 203, each after another 20 ms
    by_channel = {r.channel: r.offset_s for r in readings}
    assert by_channel == pytest.approx({101: 0.02, 111: 0.04, 203: 0.06})
    settings = meter.read_settings()
    assert settings["scan_list"] == "#214(@101,111,203)"
    assert float(settings["voltage_nplc"]) == 1.0
    assert meter.counters.retries == meter.counters.timeouts == 0
    assert meter.name == "digitiser"
    meter.close()
    meter.close()
    with pytest.raises(LinkError, match="was closed"):
        meter.scan()


def test_open_input_is_no_reading_and_no_error(pty_multimeter):
    meter = pty_multimeter.open()
    meter.configure([VOLT, OHM])
    pty_multimeter.faults.inject("sensor_break", duration_s=10.0)
    volt, ohm = meter.scan()
    assert volt.ok
    assert not ohm.ok
    assert math.isnan(ohm.value)
    pty_multimeter.wait(11.0)
    assert all(r.ok for r in meter.scan())
    pty_multimeter.plant.open_channels.add(101)
    volt, ohm = meter.scan()
    assert not volt.ok
    assert math.isnan(volt.value)
    assert ohm.value == 11_100.0


def test_another_program_s_leftovers_are_not_taken_for_answers(pty_multimeter):
    # a controller that was killed left its question behind, answered into the line
    first = pty_multimeter.open()
    first.configure(CHANNELS)
    first._link._get_in_step()
    first._link.send("READ?")
    first.close()
    pty_multimeter.wait(100.0)
    second = pty_multimeter.open()
    second.configure(CHANNELS)
    check_scan(pty_multimeter, second.scan())


# ---- the emulator's habits


def ask(bench, *lines):
    return [bench.emulator.respond(line) for line in lines]


def test_emulator_takes_short_and_long_forms_in_any_case(pty_multimeter):
    lines = (
        "*rst",
        "configure:voltage:dc 10,(@101:103,111)",
        ":SENSe:VOLTage:DC:NPLC 10,(@101)",
        "VOLT:NPLC 0.3,(@102)",
        "format:reading:channel on;time 1",
        "ROUTe:SCAN?",
        "volt:nplc? (@101:102)",
        "FORM:READ:CHAN?;TIME?;UNIT?",
        "SYST:ERR?;VERS?",
    )
    assert ask(pty_multimeter, *lines)[5:] == [
        "#218(@101,102,103,111)",
        "+1.00000000E+01,+1.00000000E+00",
        "1;1;0",
        '+0,"No error";1994.0',
    ]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("CONF:VOLT:DX 10,(@101)", -113),
        ("READ", -113),
        ("CONF:VOLT:DC 500,(@101)", -222),
        ("CONF:VOLT:DC 10,(@121)", -222),
        ("CONF:VOLT:DC 10,@101", -102),
        ("CONF:VOLT:DC", -109),
        ("FORM:READ:CHAN MAYBE", -224),
        ("VOLT:NPLC 500,(@101)", -222),
        ("RES:NPLC 1,(@101)", -221),
        ("READ?", -221),
        ("FETC?", -230),
    ],
)
def test_emulator_queues_the_standard_errors_and_answers_nothing(pty_multimeter, line, code):
    assert ask(pty_multimeter, line) == [None]
    first, second = ask(pty_multimeter, "SYST:ERR?", "SYST:ERR?")
    assert first.startswith(f"{code:+d},")
    assert second == '+0,"No error"'


def test_emulator_configuration_switches_the_fields_off_and_sets_the_scan_list(pty_multimeter):
    ask(pty_multimeter, "CONF:VOLT:DC 10,(@101)", "FORM:READ:CHAN ON", "FORM:READ:UNIT ON")
    assert ask(pty_multimeter, "READ?")[0].endswith("VDC,101")
    ask(pty_multimeter, "CONF:RES 1E6,(@112,111)")
    assert ask(pty_multimeter, "READ?") == ["+1.11000000E+04,+1.12000000E+04"]
    ask(pty_multimeter, "FORM:READ:TIME ON;:FORM:READ:ALAR ON;:ROUT:SCAN (@111);:INIT")
    assert ask(pty_multimeter, "FETC?") == ["+1.11000000E+04,000000000.020,0"]


def test_emulator_error_queue_holds_twenty(pty_multimeter):
    ask(pty_multimeter, *["NONSENSE"] * 25)
    replies = ask(pty_multimeter, *["SYST:ERR?"] * 21)
    assert replies[18].startswith("-113,")
    assert replies[19].startswith("-350,")
    assert replies[20] == '+0,"No error"'
