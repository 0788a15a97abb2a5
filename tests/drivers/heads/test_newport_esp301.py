import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DeviceError, LimitError, LinkError, ProtocolError
from drivers.heads.newport_esp301 import (
    MotionHead,
    angle_text,
    parse_esp301_error,
    parse_flag,
    parse_number,
)
from drivers.station import HeadConfig
from tests.drivers.heads.esp301_cases import NO_ERROR, RESOLUTION_DEG, VERSION, satisfies, settle

# ---- bytes


def test_transcript(transcript):
    def checked(command, answer=b""):
        return [(command + b"\r", answer), (b"TB?\r", NO_ERROR)]

    wire = transcript(
        [
            *checked(b"VE?", VERSION.encode() + b"\r\n"),  # into step
            *checked(b"2MO?", b"0\r\n"),
            *checked(b"2MO"),
            *checked(b"2VA12.5"),
            *checked(b"2PA-90.25"),
            *checked(b"2MD?", b"0\r\n"),
            *checked(b"2TP", b"-45.12500\r\n"),
            *checked(b"2ST"),
            *checked(b"2MO?", b"1\r\n"),
            *checked(b"2PA0"),
        ]
    )
    head = MotionHead(HeadConfig(url=wire.url, axis=2, speed_deg_per_s=12.5, timeout_s=2.0))
    head.move_to_deg(-90.25)
    assert head.is_moving()
    assert head.read_position_deg() == -45.125
    head.stop()
    head.move_to_deg(-0.0)
    head.close()
    wire.finish()
    assert head.counters.retries == 0


# ---- numbers and replies


@given(st.floats(-1e6, 1e6))
def test_angles_are_written_as_plain_decimals_and_read_back(angle):
    text = angle_text(angle)
    assert set(text) <= set("-0123456789.")
    assert text != "-0"
    assert parse_number(text) == pytest.approx(angle, abs=RESOLUTION_DEG)


@given(st.text(max_size=40))
def test_no_text_is_taken_for_a_number_unless_it_is_one(text):
    try:
        value = parse_number(text)
    except ProtocolError as err:
        assert "\n" not in str(err)  # noqa: PT017  both outcomes are allowed
    else:
        assert math.isfinite(value)
        assert value == float(text)


@pytest.mark.parametrize("text", ["", "nan", "inf", "1e99", "1 2", "0x10", "1_0", "12.3.4", "--1"])
def test_what_is_no_number_is_refused(text):
    with pytest.raises(ProtocolError):
        parse_number(text)


@pytest.mark.parametrize("text", ["", "2", "-1", "1.0", "ON", "90.00000"])
def test_what_is_no_flag_is_refused(text):
    with pytest.raises(ProtocolError):
        parse_flag(text)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("0, 451322, NO ERROR DETECTED", 0),
        ("113, 9, AXIS-1 MOTOR NOT ENABLED", 113),
        ("6, COMMAND DOES NOT EXIST", 6),
    ],
)
def test_error_buffer_replies(text, code):
    assert parse_esp301_error(text)[0] == code


@pytest.mark.parametrize("text", ["", "0", "90.00000", VERSION, "12, 34", "1,2,3"])
def test_what_is_no_error_buffer_reply_is_refused(text):
    with pytest.raises(ProtocolError):
        parse_esp301_error(text)


# ---- limits


@pytest.mark.parametrize("angle", [90.001, -90.001, math.nan, math.inf, -math.inf, 1e300])
def test_angles_outside_the_limits_are_refused_before_a_byte(scripted, angle):
    port = scripted({})
    head = MotionHead(HeadConfig(url=port.url, limits_deg=(-90.0, 90.0), timeout_s=0.1))
    with pytest.raises(LimitError, match="-90 to 90°"):
        head.move_to_deg(angle)
    head.close()
    assert port.sent == []


# ---- conformance


def test_conforms(head_bench):
    head = satisfies(
        head_bench.open(timeout_s=2.0, speed_deg_per_s=30.0, limits_deg=(-180.0, 180.0))
    )
    assert "ESP301" in head.identify()
    assert head.read_position_deg() == 0.0
    assert not head.is_moving()
    head.move_to_deg(90.0)
    assert head.is_moving()
    head_bench.wait(1.0)
    assert head.read_position_deg() == pytest.approx(30.0, abs=RESOLUTION_DEG)
    settle(head_bench, head)
    assert head.read_position_deg() == 90.0
    head.move_to_deg(-90.0)
    head_bench.wait(2.0)
    head.stop()
    assert not head.is_moving()
    assert head.read_position_deg() == pytest.approx(30.0, abs=RESOLUTION_DEG)
    assert head.read_settings()["speed_deg_per_s"] == 30.0
    assert head.limits_deg.hi == 180.0
    assert head.speed_deg_per_s == 30.0
    assert head.counters.retries == head.counters.timeouts == 0
    head.close()
    head.close()
    with pytest.raises(LinkError, match="was closed"):
        head.read_position_deg()


def test_a_refused_move_says_why(pty_head):
    head = pty_head.open(limits_deg=(-3600.0, 3600.0))
    with pytest.raises(DeviceError, match=r"1PA1000.*106 .*SOFTWARE LIMIT"):
        head.move_to_deg(1000.0)
    head.close()
    too_fast = pty_head.open(speed_deg_per_s=500.0)
    with pytest.raises(DeviceError, match=r"110 .*MAXIMUM VELOCITY"):
        too_fast.move_to_deg(10.0)


def test_an_axis_that_counts_in_millimetres_is_refused(pty_head):
    pty_head.emulator._axis.unit = 2
    with pytest.raises(DeviceError, match="unit 2, expected 7"):
        pty_head.open().identify()


def test_another_controller_is_recognised(scripted):
    port = scripted({"VE?": ["ESP300 Version 3.0"], "TB?": ["0, 1, NO ERROR DETECTED"]})
    head = MotionHead(HeadConfig(url=port.url, timeout_s=2.0))
    with pytest.raises(DeviceError, match="expected an ESP301"):
        head.identify()
    head.close()


def test_a_controller_that_only_knows_idn(scripted):
    port = scripted(
        {"*IDN?": ["NEWPORT ESP301 Version 3.0"], "TB?": ["0, 1, NO ERROR DETECTED"], "1SN?": ["7"]}
    )
    head = MotionHead(HeadConfig(url=port.url, timeout_s=0.1, retries=2))
    assert head.identify() == "NEWPORT ESP301 Version 3.0"
    head.close()


def test_a_motor_switched_off_at_the_panel_is_switched_on_again(pty_head):
    head = pty_head.open()
    head.move_to_deg(10.0)
    settle(pty_head, head)
    pty_head.emulator.respond("1MF;1VA1")
    head.move_to_deg(20.0)
    settle(pty_head, head)
    assert head.read_position_deg() == 20.0
    assert pty_head.emulator.respond("1VA?") == "20.00000"


def test_errors_of_another_axis_are_not_this_axis_refusals(pty_head):
    head = pty_head.open()
    head.read_position_deg()
    pty_head.emulator.respond("2PA5")
    assert head.read_position_deg() == 0.0


# ---- the emulator's habits


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("1PA10", 113),
        ("1MO;1PA1000", 106),
        ("1MO;1PA-1000", 107),
        ("1VA1000", 110),
        ("1VA-1", 101),
        ("1AC5000", 111),
        ("2TP", 208),
        ("4TP", 9),
        ("TP", 37),
        ("1MO;1PA", 38),
        ("1MO;1PAx", 7),
        ("1XX", 6),
        ("?!", 6),
    ],
)
def test_emulator_buffers_the_controller_s_errors(pty_head, line, code):
    respond = pty_head.emulator.respond
    assert respond(line) is None
    assert respond("TB?").split(",")[0] == str(code)
    assert respond("TE?") == "0"


def test_emulator_tells_servo_cycles_since_it_was_switched_on(pty_head):
    pty_head.wait(4.0)
    assert pty_head.emulator.respond("tb?") == "0, 10000, NO ERROR DETECTED"


def test_emulator_stops_when_the_motor_is_switched_off(pty_head):
    respond = pty_head.emulator.respond
    respond("1MO;1VA10;1PA90")
    pty_head.wait(2.0)
    respond("1MF")
    assert respond("1MD?") == "1"
    assert respond("1TP;1MO?") == "20.00000\r\n0"
