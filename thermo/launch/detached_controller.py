"""The process that runs a detached test: ``python -m thermo.launch.detached_controller``.

Its order comes on standard input. It says in one line of JSON on standard output that the test has
begun, or why it has not, and lets go of all three streams. Nothing that takes time is imported
before it has left its parent.
"""

import contextlib
import json
import logging
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from thermo.launch.detached import Order
    from thermo.station.outcome import TestOutcome

log = logging.getLogger(__name__)

LINGER_S = 900.0  # for notices that could not be sent yet; the chamber is safe by then


def main() -> int:
    """Leave the parent and run the test.

    Returns
    -------
    int
        0 when the test was clean, 1 when it was not, 2 when it did not begin.
    """
    message = sys.stdin.buffer.read()
    if os.fork():  # the parent's child ends here; nobody waits for what goes on
        os._exit(0)
    from errormodel.errors import WorkbenchError
    from thermo.launch.detached import Order

    order = Order.parse(message)
    try:
        outcome = _run(order)
    except Exception as err:
        from drivers.errors import InstrumentError

        text = " ".join(str(err).split()) or type(err).__name__
        if not isinstance(err, WorkbenchError | InstrumentError):
            text = f"error of the program: {type(err).__name__}: {text}"
        _refused(order, text)
        _say({"error": text})
        return 2
    return 0 if outcome.clean else 1


def _run(order: "Order") -> "TestOutcome":
    from thermo.launch.clocks import clock_of
    from thermo.launch.emulated import run_emulated
    from thermo.launch.notify import NoticeSender, read_notify
    from thermo.launch.real import run_on_station
    from thermo.store.operation.planned import has_begun
    from thermo.store.store import open_store

    job = order.job()
    clock, notify = clock_of(job, order.speed), read_notify(order.notify)
    sender = NoticeSender(order.store_url, notify)

    def on_begun(test_id: str) -> None:
        if order.planned is not None:
            with open_store(order.store_url, existing=True) as store:
                has_begun(store, order.planned, test_id)
        _say({"test_id": test_id, "pid": os.getpid()})
        sender.start()

    run = run_emulated if job.emulated else run_on_station
    outcome = run(job, clock=clock, take_over=order.take_over, on_begun=on_begun, log_to_store=True)
    _ended(order, outcome)
    sender.close(LINGER_S)
    return outcome


def _say(answer: dict[str, object]) -> None:
    """Say one line to whoever started this, and let go of the streams."""
    with contextlib.suppress(OSError):  # nobody listens any more; the test goes on
        os.write(1, (json.dumps(answer, ensure_ascii=False) + "\n").encode())
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    os.close(nothing)


def _refused(order: "Order", text: str) -> None:
    """Enter why a planned test did not begin."""
    from errormodel.errors import StoreError
    from thermo.store.operation.planned import refuse_start
    from thermo.store.store import open_store

    if order.planned is None:
        return
    try:
        with open_store(order.store_url, existing=True) as store:
            refuse_start(store, order.planned, text)
    except StoreError as err:
        log.error("%s", err)


def _ended(order: "Order", outcome: "TestOutcome") -> None:
    """Enter how the planned test that this was, or that was resumed, has ended."""
    from errormodel.errors import StoreError
    from thermo.store.operation.planned import end_planned, list_planned
    from thermo.store.store import open_store

    try:
        with open_store(order.store_url, existing=True) as store:
            mine = [p for p in list_planned(store) if p.test_id == outcome.test_id]
            for planned in mine:
                end_planned(store, planned.number, outcome.status, outcome.reason)
    except StoreError as err:
        log.error("the planned test's end is not stored: %s", err)


if __name__ == "__main__":
    sys.exit(main())
