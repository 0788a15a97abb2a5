"""Files of a user's own terms, effects, signals and groups, part of the library for a command."""

from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click

from errormodel.errors import InputError

# What such a file may define; it defines one of them at least.
MEMBERS = ("TERMS", "SIGNALS", "GROUPS", "EFFECTS")
GIVEN = "accelbench.library"  # key of the paths in a command's context
C = TypeVar("C", bound=Callable[..., Any])


@contextmanager
def library(*paths: Path | str) -> Generator[None]:
    """Make files of one's own part of the library until the end of the block.

    A file is Python and defines one or more of `TERMS` (of accelerometers over temperature, by
    name), `SIGNALS` (further recorded columns), `GROUPS` (of a SINS's sensors on a rig) and
    `EFFECTS` of either kind.

    Parameters
    ----------
    *paths : path

    Raises
    ------
    InputError
        If a file cannot be read, fails, or defines something that is not what it should be.
    """
    with ExitStack() as opened:
        for path in paths:
            opened.enter_context(_with_file(Path(path)))
        yield


@contextmanager
def _with_file(path: Path) -> Generator[None]:
    # here, as most commands are called without a file and start sooner without the other half
    from errormodel.io.python_file import members_of, run_python_file
    from sinscal.library import using_rig_library, with_rig_file
    from sinscal.library.groups import RigEffect
    from thermo.library import using_thermal_library, with_thermal_file
    from thermo.library.effects import ThermalEffect
    from thermo.recording.signals import using_signals, with_signal_file

    file = run_python_file(path)
    if not any(hasattr(file.module, name) for name in MEMBERS):
        raise InputError(path, "", f"defines none of {', '.join(MEMBERS)}")
    for one in members_of(file, "EFFECTS", object):
        if not isinstance(one, ThermalEffect | RigEffect):
            raise InputError(path, "EFFECTS", f"{one!r}: expected a ThermalEffect or a RigEffect")
    with (
        using_signals(with_signal_file(file)),
        using_thermal_library(with_thermal_file(file)),
        using_rig_library(with_rig_file(file)),
    ):
        yield


def _open(ctx: click.Context, param: click.Parameter, paths: tuple[Path, ...]) -> None:
    del param
    if paths and not ctx.resilient_parsing:
        ctx.meta[GIVEN] = paths
        ctx.with_resource(library(*paths))


def library_paths() -> tuple[Path, ...]:
    """Return the files that the present command was given by --library."""
    ctx = click.get_current_context(silent=True)
    return ctx.meta.get(GIVEN, ()) if ctx is not None else ()


def library_option(*aliases: str) -> Callable[[C], C]:
    """Return the option --library, under further names too.

    The files are part of the library until the command ends.
    """
    return click.option(
        "--library",
        *aliases,
        "library",
        multiple=True,
        type=Path,
        metavar="FILE.py",
        callback=_open,
        expose_value=False,
        is_eager=True,
        help="Terms, effects and signals of your own; repeatable.",
    )
