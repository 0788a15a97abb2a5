"""`accelbench run`: a chamber test on instruments, or on emulated ones."""

from pathlib import Path
from typing import Any

import click

from accelbench.commands.run.store_commands import store_option
from accelbench.shell.library import library_option
from accelbench.shell.outputs import force_option, json_option


@click.command()
@click.argument("sequence", type=Path, required=False, metavar="SEQUENCE.toml")
@click.option("--station", type=Path, help="Instruments; without it they are emulated.")
@store_option
@click.option("--resume", metavar="ID", help="Resume an interrupted test.")
@click.option(
    "--take-over", is_flag=True, help="Take over a chamber that is in use or switched off."
)
@click.option("--dry-run", is_flag=True, help="Print the plan without running it.")
@click.option("--detach", is_flag=True, help="Run it in a process of its own and print its id.")
@click.option("--notify", type=Path, help="File with [notify]: who is told of alarms.")
@click.option("--out", type=Path, help="Recorded run to write at the end.")
@click.option("--model", type=Path, help="TERMS.toml: the terms of the live estimate.")
@click.option(
    "--speed",
    type=click.FloatRange(min=0, min_open=True),
    help="Multiple of real time, for emulated instruments only; as fast as possible if not given.",
)
@click.option("-v", "--verbose", is_flag=True, help="Print the verdict on every ramp.")
@force_option
@library_option()
@json_option
def run(**given: Any) -> int:
    """Run a chamber test sequence.

    However it ends, the chamber is put into its safe condition and that is verified. Exit code 1:
    it ended early, a ramp was not uniform, an accelerometer has not settled in the cycles of a
    run-in, there is a complaint of the readings, or the safe condition is not verified. A chamber
    that somebody else uses is refused (exit code 2) unless --take-over says so. With --detach the
    test goes on without this terminal: accelbench control acts on it. In Python:
    accelbench.run_on_station, accelbench.run_emulated.
    """
    from accelbench.commands.run.work import run as work

    return work(**given)
