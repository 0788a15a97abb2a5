"""`accelbench control list|pause|resume|abort|acknowledge`: running tests and their alarms."""

from typing import Any

import click

from accelbench.commands.run.store_commands import store_option
from accelbench.shell.outputs import json_option

_patience = click.option(
    "--patience",
    type=click.FloatRange(min=0),
    default=20.0,
    show_default=True,
    help="Wait so long for the answer, s.",
)
_reason = click.option("--reason", default="", help="Kept with the command, and told in the test.")


@click.command("list")
@store_option
@json_option
def list_(**given: Any) -> None:
    """Show running tests, open alarms, the queue and the newest commands.

    What a controller that is gone has left behind is seen to first. In Python:
    thermo.store.operation.controllers.list_beats.
    """
    from accelbench.commands.control.work import list_ as work

    work(**given)


@click.command()
@click.argument("test_id", metavar="ID")
@store_option
@_reason
@_patience
@json_option
def pause(**given: Any) -> int:
    """Hold a running test: the chamber stays where it is, the schedule waits.

    Exit code 0: paused; 1: refused, or not answered in time. In Python:
    thermo.launch.control.ask_controller.
    """
    from accelbench.commands.control.work import ask

    return ask("pause", **given)


@click.command()
@click.argument("test_id", metavar="ID")
@store_option
@_reason
@_patience
@json_option
def resume(**given: Any) -> int:
    """Let a paused test go on, by its sequence's rule for gaps.

    Exit code 0: it goes on; 1: refused, or not answered in time. In Python:
    thermo.launch.control.ask_controller.
    """
    from accelbench.commands.control.work import ask

    return ask("resume", **given)


@click.command()
@click.argument("test_id", metavar="ID")
@store_option
@_reason
@_patience
@json_option
def abort(**given: Any) -> int:
    """End a running test: the chamber is put into its safe condition, and that is verified.

    Exit code 0: it has ended and the chamber is safe; 1: refused, not answered in time, or the
    safe condition is not verified. In Python: thermo.launch.control.ask_controller.
    """
    from accelbench.commands.control.work import ask

    return ask("abort", **given)


@click.command()
@click.argument("numbers", metavar="[ALARM]…", type=int, nargs=-1)
@click.option("--all", "every", is_flag=True, help="Acknowledge every open alarm.")
@store_option
@json_option
def acknowledge(**given: Any) -> None:
    """Acknowledge alarms by their numbers; who and when is kept for good.

    In Python: thermo.store.operation.alarms.acknowledge.
    """
    from accelbench.commands.control.work import acknowledge as work

    work(**given)
