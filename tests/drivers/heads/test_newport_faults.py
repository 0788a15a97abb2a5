"""The ESP301 on a line that misbehaves: a right position or an error, never another."""

import random

import pytest

from drivers.emulators.faults import REPLY_KINDS
from drivers.errors import InstrumentError
from drivers.heads.newport_esp301 import MotionHead
from drivers.station import HeadConfig
from tests.drivers.heads.esp301_cases import FAULTS_OF_A_CONNECTION, VERSION, settle


@pytest.mark.parametrize("kind", sorted(REPLY_KINDS))
def test_each_fault_is_survived_with_the_right_values(head_bench, kind, url):
    if url.startswith("socket") and kind not in FAULTS_OF_A_CONNECTION:
        pytest.skip("the same on both kinds of port, tried on the pseudo-terminal")
    # a split reply costs no time, so there the machine may be as busy as it likes
    head = head_bench.open(retries=8, timeout_s=2.0 if kind == "split_frame" else 0.1)
    head_bench.faults.late_s = 0.15
    head.move_to_deg(90.0)
    head_bench.wait(1.0)  # 20 °/s
    head_bench.faults.inject(kind)
    assert head.read_position_deg() == 20.0
    head_bench.wait(1.0)
    assert head.read_position_deg() == 40.0
    head_bench.faults.inject(kind)
    assert head.is_moving()
    settle(head_bench, head)
    assert head.read_position_deg() == 90.0
    if kind == "split_frame":
        assert head.counters.retries == 0
    else:
        assert head.counters.retries >= 2
        assert head.counters.reconnects >= 2


@pytest.mark.parametrize("kind", ["silence", "broken_crc", "dropped_connection"])
@pytest.mark.parametrize("reply", range(5))
def test_faults_during_a_move_command(pty_head, kind, reply):
    """The answers of MO?, TB?, TB? to MO, TB? to VA, TB? to PA, one spoiled at a time."""
    head = pty_head.open(retries=8, timeout_s=0.06)
    head.read_position_deg()
    take = pty_head.faults.take_reply_fault
    place = iter([None] * reply + [kind])
    pty_head.faults.take_reply_fault = lambda: next(place, None) or take()
    head.move_to_deg(45.0)
    settle(pty_head, head)
    assert head.read_position_deg() == 45.0


def test_a_move_is_not_repeated_when_it_arrived(pty_head):
    head = pty_head.open(retries=2, timeout_s=0.1)
    head.move_to_deg(10.0)
    settle(pty_head, head)
    lines: list[str] = []
    respond = pty_head.emulator.respond

    def listen(line):
        lines.append(line)
        return respond(line)

    pty_head.emulator._server._responder.respond = listen
    take = pty_head.faults.take_reply_fault
    place = iter([None, None, "silence"])  # MO?, its TB?, then the TB? after PA
    pty_head.faults.take_reply_fault = lambda: next(place, None) or take()
    head.move_to_deg(50.0)
    assert lines.count("1PA50") == 1
    assert "1DP?" in lines
    settle(pty_head, head)
    assert head.read_position_deg() == 50.0


def test_a_move_that_did_not_arrive_is_sent_again_and_counted(pty_head):
    head = pty_head.open(retries=2, timeout_s=0.1)
    head.move_to_deg(10.0)
    settle(pty_head, head)
    respond = pty_head.emulator.respond
    lost = iter(["1PA50", "TB?"])
    waiting = [next(lost)]

    def lose(line):
        if waiting and line == waiting[0]:
            waiting[:] = [x for x in [next(lost, None)] if x]
            return None
        return respond(line)

    pty_head.emulator._server._responder.respond = lose
    head.move_to_deg(50.0)
    assert head.counters.retries == 1
    settle(pty_head, head)
    assert head.read_position_deg() == 50.0


def test_a_storm_of_faults_gives_no_wrong_position(pty_head):
    rng = random.Random(21)
    head = pty_head.open(retries=2, timeout_s=0.08, speed_deg_per_s=1.0)
    pty_head.faults.late_s = 0.12
    head.move_to_deg(300.0)
    kinds = sorted(REPLY_KINDS)
    right = 0
    for step in range(20):
        pty_head.wait(5.0)
        for _ in range(rng.choice([0, 1, 1, 2])):
            pty_head.faults.inject(rng.choice(kinds))
        try:
            position = head.read_position_deg()
        except InstrumentError as err:
            assert "\n" not in str(err)  # noqa: PT017  both outcomes are allowed
        else:
            assert position == 5.0 * (step + 1)
            right += 1
    assert right > 12


def test_a_stale_position_before_the_true_one_is_not_taken(scripted):
    """A late line turns up after the port was opened again, whatever the fence stopped."""
    port = scripted(
        {
            "VE?": [VERSION],
            "TB?": ["0, 1, NO ERROR DETECTED"],
            "1TP": ["5.00000\r\n7.00000", "7.00000"],
        }
    )
    head = MotionHead(HeadConfig(url=port.url, timeout_s=2.0))
    assert head.read_position_deg() == 7.0
    assert head.counters.bad_replies == 1
    head.close()


def test_lines_before_the_fence_are_thrown_away(scripted):
    port = scripted(
        {
            "VE?": [f"5.00000\r\n0, 1, NO ERROR DETECTED\r\n{VERSION}"],
            "TB?": ["0, 1, NO ERROR DETECTED"],
            "1TP": ["7.00000"],
        }
    )
    head = MotionHead(HeadConfig(url=port.url, timeout_s=2.0))
    assert head.read_position_deg() == 7.0
    assert head.counters.bad_replies == 0
    head.close()


def test_stop_gets_through_a_bad_line(pty_head):
    head = pty_head.open(retries=8, timeout_s=0.08)
    head.move_to_deg(300.0)
    pty_head.wait(1.0)
    pty_head.faults.inject("silence")
    pty_head.faults.inject("broken_crc")
    head.stop()
    pty_head.wait(10.0)
    assert head.read_position_deg() == 20.0
