"""The 34970A on a line that misbehaves: a right value or an error, never another."""

import itertools
import random

import pytest

from drivers.digitisers.keysight_34970a import ScanningMultimeter
from drivers.emulators.faults import REPLY_KINDS
from drivers.errors import DeviceError, InstrumentError, LinkError
from drivers.station import DigitiserConfig
from tests.drivers.digitisers.keysight_cases import (
    CHANNELS,
    FAULTS_OF_A_CONNECTION,
    TIMEOUT_S,
    VOLT,
    check_scan,
)


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
