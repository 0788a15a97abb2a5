import itertools
import math
import random

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import drivers.digitisers.keysight_34970a
from drivers.clock import SteppedClock
from drivers.devices import Digitiser, ScanChannel
from drivers.digitisers.keysight_34970a import ScanningMultimeter
from drivers.digitisers.keysight_34970a_scpi import (
    configuration,
    parse_scan,
    parse_scpi_error,
    range_for,
)
from drivers.emulators.faults import REPLY_KINDS
from drivers.errors import DeviceError, InstrumentError, LimitError, LinkError, ProtocolError
from drivers.station import DigitiserConfig

VOLT = ScanChannel(number=101, quantity="voltage", full_scale=10.0)
VOLT2 = ScanChannel(number=203, quantity="voltage", full_scale=3.0)
OHM = ScanChannel(number=111, quantity="resistance", full_scale=400e3)
CHANNELS = (OHM, VOLT2, VOLT)  # not the order they are scanned in
TIMEOUT_S = 0.08
FAULTS_OF_A_CONNECTION = ("dropped_connection", "late_reply")  # they differ with the port
NO_ERROR = b'+0,"No error"\r\n'
IDENTITY = b"HEWLETT-PACKARD,34970A,0,13-2-2\r\n"


@pytest.fixture(autouse=True)
def no_relays(monkeypatch):
    """An emulated scan needs no settling, so that lost answers are given up sooner."""
    monkeypatch.setattr(drivers.digitisers.keysight_34970a, "SETTLE_S", 0.0)


def satisfies(device: Digitiser) -> Digitiser:
    return device


def expected_value(bench, channel: ScanChannel, offset_s: float) -> float:
    return bench.plant.channel_value(bench.clock.now_s() + offset_s, channel.number)


def check_scan(bench, readings) -> None:
    """Each reading is of its own channel and of its own time, to the digits sent."""
    assert [r.channel for r in readings] == [c.number for c in CHANNELS]
    for channel, reading in zip(CHANNELS, readings, strict=True):
        assert reading.ok
        # nine digits are sent
        assert reading.value == pytest.approx(
            expected_value(bench, channel, reading.offset_s), rel=2e-9
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


# ---- parsing

finite = st.floats(-1.2e8, 1.2e8, allow_nan=False)


@given(
    values=st.lists(finite, min_size=1, max_size=20),
    form=st.sampled_from(["+.8E", ".6f", "g", ".3e"]),
)
def test_any_decimal_notation_is_read_as_written(values, form):
    reply = ",".join(f"{format(v, form)},{0.02 * i:013.3f},{101 + i}" for i, v in enumerate(values))
    items = parse_scan(reply)
    assert [i.value for i in items] == [float(format(v, form)) for v in values]
    assert [i.channel for i in items] == [101 + i for i in range(len(values))]


@given(st.text(max_size=80))
def test_no_text_is_taken_for_a_scan_unless_it_is_one(text):
    try:
        items = parse_scan(text)
    except ProtocolError as err:
        assert "\n" not in str(err)  # noqa: PT017  both outcomes are allowed
    else:
        assert len(text.split(",")) == 3 * len(items)


GOOD = "+1.25000000E+00,000000000.040,101,-3.50000000E-03,000000000.080,102"


@example(place=GOOD.index("-"), char=" ")  # the sign lost
@given(st.integers(0, len(GOOD) - 1), st.characters(exclude_characters="+-0123456789.E,"))
def test_a_strange_character_anywhere_in_a_scan_is_noticed(place, char):
    broken = GOOD[:place] + char + GOOD[place + 1 :]
    try:
        items = parse_scan(broken)
    except ProtocolError:
        return
    # blanks beside a comma are allowed; "e" is E: neither changes a number
    assert [i.value for i in items] == [1.25, -3.5e-3]


@pytest.mark.parametrize(
    "reply",
    [
        "",
        "+1.25000000E+00",
        "+1.25000000E+00,000000000.040",
        "+1.25000000E+00,000000000.040,101,-3.5E-03",
        "+1.25000000E+00 VDC,000000000.040,101",
        "nan,000000000.040,101",
        "+1.25000000E+00,-1.0,101",
        "+1.25000000E+00,000000000.040,1.01",
        "+1.0E+00,000000000.040,101,+1.0E+00,000000000.050,101",
        "+1.0E+00,000000000.040,101,+1.0E+00,000000000.030,102",
    ],
)
def test_malformed_scans_are_refused(reply):
    with pytest.raises(ProtocolError):
        parse_scan(reply)


@pytest.mark.parametrize(
    ("reply", "expected"),
    [
        ('+0,"No error"', (0, "No error")),
        ('0,"No error"', (0, "No error")),
        ('-113,"Undefined header"', (-113, "Undefined header")),
        ('-222,"Data out of range; nplc"', (-222, "Data out of range; nplc")),
    ],
)
def test_error_queue_replies(reply, expected):
    assert parse_scpi_error(reply) == expected


@pytest.mark.parametrize("reply", ["", "0", "+1.25000000E+00,000000000.040,101", "No error"])
def test_what_is_no_error_queue_reply_is_refused(reply):
    with pytest.raises(ProtocolError):
        parse_scpi_error(reply)


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


# ---- misbehaviour


@pytest.mark.parametrize("kind", sorted(REPLY_KINDS))
def test_each_fault_is_survived_with_the_right_values(multimeter, kind, url):
    if url.startswith("socket") and kind not in FAULTS_OF_A_CONNECTION:
        pytest.skip("the same on both kinds of port, tried on the pseudo-terminal")
    # a split reply costs no time, so there the machine may be as busy as it likes
    meter = multimeter.open(retries=8, timeout_s=2.0 if kind == "split_frame" else TIMEOUT_S)
    meter.configure(CHANNELS)
    meter.scan()
    multimeter.wait(30.0)  # what was measured before is another number from here on
    multimeter.faults.inject(kind)
    check_scan(multimeter, meter.scan())
    multimeter.wait(30.0)
    check_scan(multimeter, meter.scan())
    counters = meter.counters
    if kind == "split_frame":
        assert counters.retries == 0
    else:
        assert counters.retries >= 1
        assert counters.reconnects >= 1
        assert counters.last_fault


@pytest.mark.parametrize("kind", ["silence", "exception", "dropped_connection"])
@pytest.mark.parametrize("reply", range(3))
def test_faults_while_configuring(pty_multimeter, kind, reply):
    meter = pty_multimeter.open(retries=8, timeout_s=0.08)
    answers = itertools.count()
    take = pty_multimeter.faults.take_reply_fault
    pty_multimeter.faults.take_reply_fault = lambda: (
        kind if next(answers) == 2 + 3 * reply else take()
    )
    meter.configure(CHANNELS)
    check_scan(pty_multimeter, meter.scan())


def test_an_instrument_that_stays_silent_is_given_up(pty_multimeter):
    meter = pty_multimeter.open(retries=1, timeout_s=0.05)
    meter.configure([VOLT])
    pty_multimeter.faults.inject("silence", count=50)
    with pytest.raises(LinkError, match="no answer"):
        meter.scan()
    pty_multimeter.faults.clear()
    assert meter.scan()[0].ok, "it is asked again from the beginning once it answers"


def test_a_storm_of_faults_stores_no_wrong_value(pty_multimeter):
    """Random faults, several in a row: a scan is right or an error, never something else."""
    rng = random.Random(20)
    meter = pty_multimeter.open(retries=2, timeout_s=0.08)
    meter.configure(CHANNELS)
    kinds = sorted(REPLY_KINDS - {"late_reply"})
    pty_multimeter.faults.late_s = 0.25  # a scan is waited for 0.08 s and 0.04 s a channel
    right = 0
    for step in range(15):
        pty_multimeter.wait(10.0)
        for _ in range(rng.choice([0, 1, 1, 2])):
            pty_multimeter.faults.inject("late_reply" if step % 10 == 7 else rng.choice(kinds))
        try:
            readings = meter.scan()
        except InstrumentError as err:
            assert "\n" not in str(err)  # noqa: PT017  both outcomes are allowed
        else:
            check_scan(pty_multimeter, readings)
            right += 1
    assert right > 9


def test_a_scan_of_other_channels_is_not_taken(scripted):
    no_error = ['+0,"No error"']
    other = "+1.0E+00,000000000.020,102"
    own = "+2.0E+00,000000000.020,101"
    port = scripted(
        {
            "*IDN?": ["HP,34970A,0,1"],
            "SYST:ERR?": no_error,
            "READ?": [other, f"{own}\r\n{own}", own],
        }
    )
    meter = ScanningMultimeter(DigitiserConfig(url=port.url, timeout_s=2.0))
    meter.configure([VOLT])
    assert meter.scan()[0].value == 2.0
    # the first was of another channel, the second had a line too many, each seen and counted
    assert meter.counters.bad_replies == 2
    assert meter.counters.retries == 2
    meter.close()


def test_a_reading_with_a_digit_lost_is_not_taken(scripted):
    good = "+1.25000000E+00,000000000.020,101"
    short = "+1.2500000E+00,000000000.020,101"
    port = scripted(
        {"*IDN?": ["HP,34970A,0,1"], "SYST:ERR?": ['+0,"No error"'], "READ?": [good, short, good]}
    )
    meter = ScanningMultimeter(DigitiserConfig(url=port.url, timeout_s=2.0))
    meter.configure([VOLT])
    assert [meter.scan()[0].value, meter.scan()[0].value] == [1.25, 1.25]
    assert meter.counters.bad_replies == 1
    meter.close()


def test_a_refused_scan_says_why(scripted):
    port = scripted(
        {
            "*IDN?": ["HP,34970A,0,1"],
            "SYST:ERR?": ['+0,"No error"'] * 19 + ['-221,"Settings conflict"', '+0,"No error"'],
        }
    )
    meter = ScanningMultimeter(DigitiserConfig(url=port.url, timeout_s=0.1, retries=1))
    meter.configure([VOLT])
    port.script.replies["SYST:ERR?"] = ['-221,"Settings conflict"', '+0,"No error"']
    with pytest.raises(DeviceError, match="-221 Settings conflict"):
        meter.scan()
    meter.close()


def test_time_lost_on_a_repeated_scan_is_in_the_offsets(pty_multimeter):
    """The clock goes on while the first question is left unanswered."""
    meter = pty_multimeter.open()
    meter.configure([VOLT])
    respond = pty_multimeter.emulator.respond
    lost = iter([True])

    def respond_late(line):
        if line == "READ?" and next(lost, False):
            pty_multimeter.wait(7.0)
            return None
        return respond(line)

    pty_multimeter.emulator._server._responder.respond = respond_late
    called_s = pty_multimeter.clock.now_s()
    (reading,) = meter.scan()
    assert reading.offset_s == pytest.approx(7.02)
    assert reading.value == pytest.approx(
        pty_multimeter.plant.channel_value(called_s + reading.offset_s, 101), rel=2e-9
    )


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
