"""`accelbench runs`, `export` and `emulate`: what the store has, and instruments alone."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.library import library_option
from accelbench.shell.outputs import force_option, json_option

store_option = click.option(
    "--store",
    default="accelbench.sqlite",
    show_default=True,
    help="SQLite file or postgresql:// URL.",
)


@click.command()
@store_option
@json_option
def runs(**given: Any) -> None:
    """List the tests in a store.

    What a test could not bring into it flows in first. Files that belong to it and were left
    behind are warned of. In Python: accelbench.open_existing_store.
    """
    from accelbench.commands.run.store_work import runs as work

    work(**given)


@click.command()
@click.argument("test_id", metavar="ID")
@store_option
@click.option("--out", type=Path, required=True, help="The recorded run to write.")
@force_option
@library_option()
@json_option
def export(**given: Any) -> None:
    """Write a test of a store as a recorded run.

    Accelerometers of different unit or nominal scale go into files of their own. In Python:
    accelbench.stored_runs.
    """
    from accelbench.commands.run.store_work import export as work

    work(**given)


@click.command()
@click.argument("station", type=Path, metavar="STATION.toml")
@click.option("--speed", type=click.FloatRange(min=0, min_open=True), help="Multiple of real time.")
@library_option()
@json_option
def emulate(**given: Any) -> None:
    """Serve the instruments of a station file until stopped.

    They answer on the ports the file names: port 0 picks a free one, "auto" a pseudo-terminal of
    its own. `accelbench run --station` of the same file drives them. In Python:
    thermo.launch.emulated.emulated.
    """
    from accelbench.commands.run.store_work import emulate as work

    work(**given)
