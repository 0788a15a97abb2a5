"""The kinds of faults of the campaign: what each promises, and the beginning that they share."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from tests.thermo.station.campaign.case import Case

PATIENCE_S = 25.0  # a loaded machine is slow; nothing here may take that long
END_S = 180.0  # for a test to run to its end, imports of a new interpreter among it


@dataclass
class Result:
    """What a kind promises: exit codes, how soon the chamber is safe, words that must be said."""

    codes: tuple[int, ...]
    within_s: float | None = PATIENCE_S  # None: never ours, nothing may be written
    says: str = ""
    where: list[str] = field(default_factory=list)  # stores that hold the readings, if not the one
    problems: list[str] = field(default_factory=list)
    resumable: bool = False


KINDS: dict[str, tuple[Callable[[Case], Result], int, dict[str, str]]] = {}


def kind(weight: int, **bench: str):
    def enter(function: Callable[[Case], Result]) -> Callable[[Case], Result]:
        KINDS[function.__name__] = (function, weight, bench)
        return function

    return enter


class NotSetError(AssertionError):
    """The test was over, or had not begun, when the fault was to come: nothing was tried."""


def begin(case: Case, *more: str, low: int = 1, high: int = 11, **how) -> None:
    """Start a test, wait for a random slot, and note the time of the fault."""
    case.start(*more, **how)
    if not case.wait_for_slots(case.rng.randint(low, high)):
        raise NotSetError("the test ended before its fault: " + case.process.text()[-600:])
    time.sleep(case.rng.random() * 0.25)
    case.strike()


def end(case: Case, patience_s: float = END_S) -> None:
    if case.process.wait(patience_s) is None:
        raise AssertionError("the controller does not end: " + case.process.text()[-600:])
