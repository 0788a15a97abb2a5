"""Controllers that are gone: an alarm is raised, the test is closed, the guardian's result is kept.

May be called by anybody at any time: what is done already is not done again.
"""

import logging
import socket

from errormodel.errors import StoreError
from thermo.safety.guardian_record import GuardianRecord
from thermo.safety.guardian_results import collect_result, pending_results
from thermo.safety.processes import is_alive
from thermo.store.operation.alarms import list_alarms, raise_alarm
from thermo.store.operation.commands import refuse_left
from thermo.store.operation.controllers import ControllerBeat, end_beat, list_beats
from thermo.store.operation.planned import end_planned, list_planned
from thermo.store.spool.recover import ENDED, recover
from thermo.store.store import Store

log = logging.getLogger(__name__)


def is_gone(beat: ControllerBeat) -> bool:
    """Return True if the process that told this is known to be gone, or silent on another host."""
    if beat.state != "running":
        return True
    if beat.host == socket.gethostname() and beat.pid_start is not None:
        return not is_alive(beat.pid, beat.pid_start)
    return beat.is_silent


def settle_dead_controllers(store: Store, store_url: str) -> tuple[str, ...]:
    """See to the tests whose controllers are gone, and to what their guardians have left.

    Parameters
    ----------
    store : Store
        Open.
    store_url : str
        The same; guardians' results lie beside it.

    Returns
    -------
    tuple of str
        The tests whose controllers were found gone now.

    Raises
    ------
    StoreError
        If the store does not answer.
    """
    dead = [
        beat
        for beat in list_beats(store, running_only=True)
        if is_gone(beat) and not store.is_claimed(beat.test_id)
    ]
    lost = tuple(beat.test_id for beat in dead if _settle(store, beat))
    for record in pending_results(store_url):
        if store.has_test(record.test_id):
            _collect(store, record)
    return lost


def _settle(store: Store, beat: ControllerBeat) -> bool:
    test_id = beat.test_id
    was_running = store.test(test_id).status == "running"
    if was_running:
        recover(store)  # what it left in a spool, and its status
    status = store.test(test_id).status
    mended = status == "interrupted" and store.test(test_id).outcome == ENDED
    if not end_beat(store, beat):
        return False
    refuse_left(store, test_id, "its controller is gone; resume the test")
    for planned in list_planned(store, open_only=True):
        if planned.test_id == test_id and status != "running":
            end_planned(store, planned.number, status, store.test(test_id).outcome)
    if mended:
        text = f"process {beat.pid} on {beat.host} is gone, last heard {beat.beat_utc}"
        raise_alarm(store, "controller lost", text, test_id=test_id)
    return mended


def _collect(store: Store, record: GuardianRecord) -> None:
    """Tell of a guardian's result once, and enter it when there is nobody left to change it."""
    kind = "guardian" if record.verified else "not safe"
    text = f"guardian: {record.text}"
    known = [a for a in list_alarms(store, record.test_id) if a.kind == kind and a.text == text]
    if not known and (record.verified or record.needs_help):
        raise_alarm(store, kind, text, test_id=record.test_id)
    if record.alive:
        return  # it has more to tell
    if store.is_claimed(record.test_id):
        return  # a controller that is stopped, or that takes it up itself
    try:
        collect_result(store, record.test_id, record.path)
    except StoreError as err:
        log.warning("%s: %s", record.path, err)
