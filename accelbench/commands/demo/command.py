"""`accelbench demo`: everything once, on instruments that are not there."""

from pathlib import Path
from typing import Any

import click

from accelbench.shell.library import library_option
from accelbench.shell.outputs import json_option


@click.command()
@click.option(
    "--out",
    type=Path,
    default=Path("accelbench-demo"),
    show_default=True,
    help="Folder in which a numbered folder is created.",
)
@click.option(
    "--hidden",
    metavar="EFFECT",
    is_flag=False,
    flag_value="",
    help="Hide an effect in one accelerometer and find it; unknown: one that is in no library.",
)
@click.option(
    "--speed",
    type=click.FloatRange(min=0, min_open=True),
    help="Multiple of real time; as fast as possible if not given.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="With --hidden: seed of the accelerometers, of the choice of the affected one, and of "
    "all noise.",
)
@library_option()
@json_option
def demo(**given: Any) -> int:
    """Do the whole job on emulated instruments: test, fit, compensation, report.

    A chamber controller on TCP, a multimeter and an indexing head on pseudo-terminals, three
    accelerometers, two runs from −40 to +70 °C and back. One accelerometer hides an effect that
    no polynomial can hold. In Python: accelbench.commands.demo.whole_job.run_demo.

    With --hidden one of three accelerometers has an effect that the program is not told of: it is
    measured, named by `discrepancy` from the recorded file, and the larger model is emulated beside
    the next run. With --hidden unknown the effect is in no library: a shape is built in place
    of a name. In Python: accelbench.commands.demo.hidden.run_hidden_demo.
    """
    from accelbench.commands.demo.work import demo as work

    return work(**given)
