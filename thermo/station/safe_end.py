"""The safe end: leaving a station in its safe condition after any event."""

import json
import logging
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.devices import Chamber, IndexingHead, SafeResult
from drivers.errors import FencedError
from thermo.station.session import Heartbeat, no_heartbeat

log = logging.getLogger(__name__)

RETRY_S = 120.0  # time of repeated attempts to make a chamber safe
PAUSE_S = 5.0  # between two attempts
SLICE_S = 0.2  # real seconds between two beats while waiting
MIN_ATTEMPTS = 4  # also if the clock is so fast that RETRY_S is negligible


@dataclass(frozen=True, slots=True, kw_only=True)
class CleanUp:
    """Result of the clean-up."""

    chamber: SafeResult
    head_stopped: bool
    fenced: str = ""  # why the guardian took the chamber over, when it did


def make_chamber_safe(
    chamber: Chamber,
    temp_c: float,
    clock: Clock,
    *,
    retry_s: float = RETRY_S,
    min_attempts: int = MIN_ATTEMPTS,
    heartbeat: Heartbeat = no_heartbeat,
) -> SafeResult:
    """Put a chamber into the safe condition and verify it, with fresh attempts.

    Only the end of the process or a guardian that has taken over stops it. Any other exception,
    including Ctrl-C, ends one attempt only.

    Parameters
    ----------
    chamber : Chamber
    temp_c : float
        Safe temperature, °C.
    clock : Clock
    retry_s : float
        How long to try, s on `clock`.
    min_attempts : int
        Smallest number of attempts.
    heartbeat : callable
        Called before every attempt and in every slice of a wait.

    Returns
    -------
    SafeResult
        The verified result, or the last; failed attempts are listed, equal failures once.

    Raises
    ------
    FencedError
        If `heartbeat` finds that the guardian has taken the chamber over.
    """
    steps: list[str] = []
    last: tuple[str, ...] = ()
    began_s = clock.now_s()
    attempt = first = 0
    while True:
        attempt += 1
        _beat(heartbeat)
        try:
            result = chamber.make_safe(temp_c)
            if result.verified:
                return SafeResult(verified=True, steps=(*steps, *result.steps))
            failed = (*result.steps, "not verified")
        except FencedError as err:
            return SafeResult(verified=False, steps=(*steps, one_line(err)))
        except BaseException as err:
            failed = (one_line(err),)
        if failed == last:
            steps[-1] = f"attempts {first} to {attempt}: {failed[-1]}"
        else:
            first, last = attempt, failed
            steps += (*failed[:-1], f"attempt {attempt}: {failed[-1]}")
        log.warning("%s: safe condition not verified, attempt %d", _name(chamber), attempt)
        try:
            if attempt >= min_attempts and clock.now_s() - began_s >= retry_s:
                return SafeResult(verified=False, steps=tuple(steps))
            _wait(clock, PAUSE_S, heartbeat)
        except FencedError:
            raise
        except BaseException as err:
            steps.append(f"wait after attempt {attempt}: {one_line(err)}")


def _beat(heartbeat: Heartbeat) -> None:
    """Send a heartbeat; only a take-over by the guardian has an effect here."""
    try:
        for line in heartbeat():
            log.warning("%s", line)
    except FencedError:
        raise
    except BaseException as err:
        log.warning("%s", one_line(err))


def _wait(clock: Clock, wait_s: float, heartbeat: Heartbeat) -> None:
    speed = getattr(clock, "speed", None)
    slice_s = wait_s if speed is None else SLICE_S * speed
    end_s = clock.now_s() + wait_s
    while (now_s := clock.now_s()) < end_s:
        clock.sleep_until_s(min(end_s, now_s + slice_s))
        _beat(heartbeat)


def stop_head(head: IndexingHead) -> tuple[bool, str]:
    """Stop a head and verify it; a second attempt follows if the first fails.

    Returns
    -------
    bool, str
        True if it does not move, and one line of text.
    """
    line = ""
    for _ in range(2):
        try:
            head.stop()
            if not head.is_moving():
                return True, "head: stopped"
            line = "head: commanded to stop, still turning"
        except BaseException as err:
            line = f"head: cannot be stopped: {one_line(err)}"
    log.warning("%s", line)
    return False, line


def clean_up(
    chamber: Chamber,
    head: IndexingHead,
    safe_temp_c: float,
    clock: Clock,
    *,
    chamber_commanded: bool,
    head_commanded: bool,
    heartbeat: Heartbeat = no_heartbeat,
) -> CleanUp:
    """Make the chamber safe, then stop the head; the chamber is the greater hazard.

    Nothing is written to an instrument that this session never commanded, because somebody else may
    use it.

    Parameters
    ----------
    chamber, head
        The instruments.
    safe_temp_c : float
        °C.
    clock : Clock
    chamber_commanded, head_commanded : bool
        True if this session commanded it.
    heartbeat : callable
        As for `make_chamber_safe`.

    Returns
    -------
    CleanUp
        `chamber.steps` ends with a line about the head.
    """
    fenced = ""
    steps: tuple[str, ...] = ("nothing was written to it",)
    safe = SafeResult(verified=False, steps=steps, commanded=False)
    if chamber_commanded:
        try:
            safe = make_chamber_safe(chamber, safe_temp_c, clock, heartbeat=heartbeat)
            _beat(heartbeat)
        except FencedError as err:
            fenced = one_line(err)
            safe = SafeResult(verified=False, steps=(fenced,), commanded=False)
    stopped, line = stop_head(head) if head_commanded else _see_head(head)
    return CleanUp(
        chamber=SafeResult(
            verified=safe.verified, steps=(*safe.steps, line), commanded=safe.commanded
        ),
        head_stopped=stopped,
        fenced=fenced,
    )


def _see_head(head: IndexingHead) -> tuple[bool, str]:
    """Return, without a write, whether a head that was never commanded is at rest."""
    try:
        moving = head.is_moving()
    except BaseException as err:
        return False, f"head: not commanded, not seen: {one_line(err)}"
    return not moving, f"head: not commanded, {'turning' if moving else 'stands'}"


def safe_json(safe: SafeResult) -> str:
    """Write a result for the store."""
    data = {"verified": safe.verified, "commanded": safe.commanded, "steps": list(safe.steps)}
    return json.dumps(data, ensure_ascii=False)


def one_line(err: BaseException) -> str:
    """Tell an exception in one line."""
    text = " ".join(str(err).split())
    return text or type(err).__name__


def _name(chamber: Chamber) -> str:
    try:
        return chamber.name
    except Exception:
        return "chamber"
