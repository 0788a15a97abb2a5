"""Asking a running test for something from another process, and waiting for its answer."""

import os
import socket
import time

from thermo.launch.dead_controllers import is_gone
from thermo.safety.processes import user_name
from thermo.store.operation.commands import Action, Command, ask, read_command, withdraw
from thermo.store.operation.controllers import ControllerBeat, read_beat
from thermo.store.store import Store

PATIENCE_S = 20.0  # for an answer, real s
LOOK_S = 0.1


def who_asks() -> str:
    """Return who works at this terminal: user@host."""
    return f"{user_name(os.getuid())}@{socket.gethostname()}"


def ask_controller(
    store: Store,
    action: Action,
    test_id: str,
    *,
    who: str,
    reason: str = "",
    patience_s: float = PATIENCE_S,
) -> Command:
    """Ask a test's controller to pause, resume or abort it, and wait for what comes of it.

    Parameters
    ----------
    store : Store
    action : Action
        "pause", "resume" or "abort".
    test_id : str
    who : str
        Kept with the command for good.
    reason : str
    patience_s : float
        Real seconds to wait for the answer.

    Returns
    -------
    Command
        Refused at once where no controller is alive; not answered (`Command.answered` is False)
        when it took too long: then it stays in the queue.

    Raises
    ------
    StoreError
        If there is no such test, or the store does not answer.
    """
    store.test(test_id)
    arguments = {"reason": reason} if reason else {}
    number = ask(store, action, who=who, test_id=test_id, arguments=arguments)
    give_up_s = time.monotonic() + patience_s
    while True:
        command = read_command(store, number)
        if command.answered:
            return command
        beat = read_beat(store, test_id)
        if beat is None or is_gone(beat):
            withdraw(store, number, no_controller(store, test_id, beat))
            return read_command(store, number)
        if time.monotonic() >= give_up_s:
            return command
        time.sleep(LOOK_S)


def no_controller(store: Store, test_id: str, beat: ControllerBeat | None) -> str:
    """Return in a sentence that no controller is alive for a test, and what became of it."""
    test = store.test(test_id)
    heard = "none has ever been heard" if beat is None else f"last heard {beat.beat_utc[:19]} UTC"
    ended = "" if test.status == "running" else f"; it is {test.status}: {test.outcome}"
    return f"no controller is alive for test {test_id} ({heard}){ended}"
