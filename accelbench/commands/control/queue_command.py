"""`accelbench control plan|arm|start|withdraw|serve|notify`: the queue and who works on it."""

from pathlib import Path
from typing import Any

import click

from accelbench.commands.run.store_commands import store_option
from accelbench.shell.library import library_option
from accelbench.shell.outputs import json_option

notify_option = click.option(
    "--notify",
    type=Path,
    help="File with [notify]: who is told; accelbench/notify.toml of the user's settings if not "
    "given.",
)


@click.command()
@click.argument("sequence", type=Path, metavar="SEQUENCE.toml")
@click.option("--station", type=Path, help="Instruments; without it they are emulated.")
@click.option(
    "--speed",
    type=click.FloatRange(min=0, min_open=True),
    help="Multiple of real time, for emulated instruments only.",
)
@click.option(
    "--after", type=int, metavar="N", help="Start by itself after the good end of planned test N."
)
@store_option
@library_option()
@json_option
def plan(**given: Any) -> None:
    """Put a test into the queue; nothing starts before it is armed.

    In Python: thermo.store.operation.planned.plan_test.
    """
    from accelbench.commands.control.queue_work import plan as work

    work(**given)


@click.command()
@click.argument("number", type=int, metavar="N")
@store_option
@library_option()
@json_option
def arm(**given: Any) -> int:
    """Look at everything that a planned test needs, and arm it when all of it is good.

    Instruments are asked who they are and how they stand; nothing is commanded. Exit code 1:
    something is not good, with what to do about it; the test is not armed. In Python:
    thermo.launch.arming.check_arming.
    """
    from accelbench.commands.control.queue_work import arm as work

    return work(**given)


@click.command()
@click.argument("number", type=int, metavar="[N]", required=False)
@click.option("--resume", metavar="ID", help="Go on with an interrupted test.")
@click.option(
    "--patience",
    type=click.FloatRange(min=0),
    default=120.0,
    show_default=True,
    help="Wait so long for the answer, s.",
)
@store_option
@json_option
def start(**given: Any) -> int:
    """Ask the runner (accelbench control serve) to start an armed test, or to go on with one.

    Exit code 0: it has begun; 1: refused, or not answered in time. In Python:
    thermo.store.operation.commands.ask.
    """
    from accelbench.commands.control.queue_work import start as work

    return work(**given)


@click.command()
@click.argument("number", type=int, metavar="N")
@store_option
@json_option
def withdraw(**given: Any) -> None:
    """Take a planned test that has not been started out of the queue.

    In Python: thermo.store.operation.planned.withdraw_test.
    """
    from accelbench.commands.control.queue_work import withdraw as work

    work(**given)


@click.command()
@store_option
@notify_option
@json_option
def serve(**given: Any) -> None:
    """Start what is asked for and what is due in the queue, and send notices, until stopped.

    Each test runs in a process of its own, and goes on when this one ends. One at a time works on
    a store. In Python: thermo.launch.runner.Runner.
    """
    from accelbench.commands.control.queue_work import serve as work

    work(**given)


@click.command()
@click.option("--test", "trial", is_flag=True, help="Send a trial to every address.")
@notify_option
@json_option
def notify(**given: Any) -> int:
    """Show who is told of alarms, and try the addresses.

    Exit code 1: an address did not take the trial. In Python: thermo.launch.notify.deliver.
    """
    from accelbench.commands.control.queue_work import notify as work

    return work(**given)
