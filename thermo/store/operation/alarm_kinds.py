"""Every kind of alarm: what it means, and what to do; the one table of them."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

Kind: TypeAlias = Literal[
    "finished",
    "complaint",
    "aborted",
    "interrupted",
    "resumed",
    "not started",
    "controller lost",
    "guardian",
    "not safe",
    "over-temperature",
    "limits",
    "chamber alarm",
    "foreign change",
    "link lost",
    "sensor",
    "late",
    "store",
    "program error",
]
Weight: TypeAlias = Literal["news", "warning", "danger"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmKind:
    """A kind of alarm.

    Attributes
    ----------
    title : str
        In two or three words.
    weight : Weight
        "news": nothing is wrong. "warning": look at it. "danger": somebody has to go there.
    meaning, remedy : str
        A sentence each.
    """

    title: str
    weight: Weight
    meaning: str
    remedy: str


ALARM_KINDS: dict[Kind, AlarmKind] = {
    "finished": AlarmKind(
        title="Test finished",
        weight="news",
        meaning="The test ran to its end and the chamber's safe condition was read back.",
        remedy="Take the accelerometers out when the chamber is there, and fit the recorded run.",
    ),
    "complaint": AlarmKind(
        title="Finished with complaints",
        weight="warning",
        meaning="The test ran to its end, but something in it makes its readings doubtful.",
        remedy="Read the complaints among its events before its readings are used.",
    ),
    "aborted": AlarmKind(
        title="Test aborted",
        weight="warning",
        meaning="Somebody ended the test; it can be resumed.",
        remedy="Resume it when the reason is gone, or leave it: it never goes on by itself.",
    ),
    "interrupted": AlarmKind(
        title="Test interrupted",
        weight="warning",
        meaning="A signal of the system ended the test's process; the test can be resumed.",
        remedy="See why the process was ended (shutdown, service stopped), then resume the test.",
    ),
    "resumed": AlarmKind(
        title="Test resumed",
        weight="news",
        meaning="An interrupted test goes on by its sequence's rule for gaps.",
        remedy="Nothing; its readings before the gap may be repeated.",
    ),
    "not started": AlarmKind(
        title="Test not started",
        weight="warning",
        meaning="A planned test could not be started; nothing was commanded.",
        remedy="Do what the text says, then arm and start it again.",
    ),
    "controller lost": AlarmKind(
        title="Controller lost",
        weight="danger",
        meaning="The process that ran the test is gone; the guardian makes the chamber safe.",
        remedy="Wait for the guardian's result, look at the chamber, then resume the test.",
    ),
    "guardian": AlarmKind(
        title="Guardian acted",
        weight="warning",
        meaning="The guardian took the chamber over, or had to be replaced by another.",
        remedy="Read its result; see why the controller or the guardian was stopped or killed.",
    ),
    "not safe": AlarmKind(
        title="Safe condition not verified",
        weight="danger",
        meaning="The chamber was told to be safe, but that could not be read back.",
        remedy="Go to the chamber now and set it to its safe temperature by hand.",
    ),
    "over-temperature": AlarmKind(
        title="Over-temperature",
        weight="danger",
        meaning="The chamber or an accelerometer was hotter than its limit; the test has ended.",
        remedy="See that the chamber cools down, and find the cause before the test is resumed.",
    ),
    "limits": AlarmKind(
        title="Limit passed",
        weight="warning",
        meaning="A reading was outside the limits of the sequence; the test has ended.",
        remedy="Look at chamber and limits; resume the test when they agree.",
    ),
    "chamber alarm": AlarmKind(
        title="Alarm of the chamber",
        weight="danger",
        meaning="The chamber's own controller shows an alarm; the test has ended.",
        remedy="Go to the chamber, clear the alarm shown there, then resume the test.",
    ),
    "foreign change": AlarmKind(
        title="Chamber changed by somebody",
        weight="warning",
        meaning="Set point, mode, profile or a setting of it was changed by somebody else.",
        remedy="Ask who did it; resume the test when the chamber is free again.",
    ),
    "link lost": AlarmKind(
        title="Instrument lost",
        weight="warning",
        meaning="An instrument did not answer for longer than allowed; the test has ended.",
        remedy="See to its power and cable, then resume the test.",
    ),
    "sensor": AlarmKind(
        title="Sensor doubtful",
        weight="warning",
        meaning="A thermistor, an output or the head shows what cannot be true, or nothing.",
        remedy="Look at the wiring of the one that is named; its readings are flagged.",
    ),
    "late": AlarmKind(
        title="Readings late or missed",
        weight="warning",
        meaning="Readings were taken late by more than a tenth of their interval, or left out.",
        remedy="See what keeps the computer or an instrument busy; a longer interval helps, too.",
    ),
    "store": AlarmKind(
        title="Store does not answer",
        weight="warning",
        meaning="The store is full, locked or away; readings go into the spool on this machine.",
        remedy="Make room on the store's disk, or see to its server; the spool then flows in.",
    ),
    "program error": AlarmKind(
        title="Error of the program",
        weight="danger",
        meaning="The test ended by an error of the program, on the same safe way as always.",
        remedy="Report the text with the test's events; the test can be resumed.",
    ),
}
assert set(ALARM_KINDS) == set(get_args(Kind))
