"""The command `accelbench`: parses, calls one function, shows what came out.

Exit codes: 0 done; 1 a criterion failed or the work was stopped; 2 misuse or bad input, told in
one line on standard error, with nothing written.
"""

import contextlib
import logging
import os
import sys
import warnings
from collections.abc import Generator, Sequence

import click

from drivers.errors import InstrumentError
from errormodel.errors import WorkbenchError
from workbench.console import HeldWarnings
from workbench.lazy import LazyGroup

DONE, FAILED, MISUSE = 0, 1, 2


# name: module, attribute, what it does
COMMANDS = {
    "demo": ("commands_demo", "demo", "The whole job on emulated instruments."),
    "run": ("commands_run", "run", "Run a chamber test sequence."),
    "make-safe": ("commands_safe", "make_safe", "Put a chamber into its safe condition."),
    "runs": ("commands_store", "runs", "List the tests in a store."),
    "export": ("commands_store", "export", "Write a test of a store as a recorded run."),
    "import": ("commands_fit", "import_", "Make a recorded run of somebody else's log."),
    "fit": ("commands_fit", "fit", "Fit each accelerometer's error model over temperature."),
    "runin": ("commands_runin", "runin", "Judge a run-in: settled, or how many cycles more."),
    "compensate": ("commands_fit", "compensate", "Apply a model to recorded runs."),
    "stability": ("commands_stability", "stability", "Compare runs: does each coefficient repeat?"),
    "rig": ("commands_rig", "rig", "Plan, simulate and evaluate the rig calibration of a SINS."),
    "combine": ("commands_combine", "combine", "Calibrate a SINS with its chamber models."),
    "discrepancy": (
        "commands_discrepancy",
        "discrepancy",
        "Name the effect that a model lacks, and add it.",
    ),
    "emulate": ("commands_store", "emulate", "Serve the instruments of a station file."),
}


class _StoppedError(Exception):
    """Ctrl-C, without the line that click adds to it."""


class _ReaderGoneError(Exception):
    """A broken pipe, without the exit that click makes of it."""


class _Commands(LazyGroup):
    """The program's commands; how they end is told by `main`."""

    table = COMMANDS

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise _StoppedError from None
        except BrokenPipeError:
            raise _ReaderGoneError from None


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="accelbench")
def accelbench() -> None:
    """Characterise accelerometers over temperature, and compensate them.

    Every command takes --json: one JSON document on standard output and nothing else. Exit codes:
    0 done, 1 a criterion failed, 2 misuse or bad input.
    """


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name; by default those of the process.

    Returns
    -------
    int
        0 done, 1 a criterion failed, 2 misuse or bad input.
    """
    # the matrices here are long and narrow: more threads only wait for one another
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, OSError):
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    with _warnings_held() as held:
        code, complaint = _run(list(sys.argv[1:] if argv is None else argv), held)
        if code != MISUSE:
            held.go_live()
    if complaint:
        click.echo(f"accelbench: {' '.join(complaint.split())}", err=True)
    return code


def _run(argv: list[str], held: HeldWarnings) -> tuple[int, str]:
    """Return the exit code, and a complaint when there is one."""
    try:
        result = accelbench.main(args=argv, prog_name="accelbench", standalone_mode=False, obj=held)
        return (result if isinstance(result, int) else DONE), ""
    except click.exceptions.NoArgsIsHelpError as err:
        click.echo(err.ctx.get_help())
        group = err.ctx.command
        names = group.list_commands(err.ctx) if isinstance(group, click.Group) else []
        return MISUSE, f"no command given, expected one of {', '.join(names)}"
    except click.UsageError as err:
        where = err.ctx.command_path.removeprefix("accelbench").strip() if err.ctx else ""
        return MISUSE, ": ".join(part for part in (where, err.format_message()) if part)
    except (WorkbenchError, InstrumentError) as err:
        return MISUSE, str(err)
    except (_StoppedError, KeyboardInterrupt, click.Abort):
        return FAILED, "stopped"
    except (_ReaderGoneError, BrokenPipeError):
        _leave_pipe()
        return DONE, ""
    except OSError as err:
        return MISUSE, f"{err.filename or 'file'}: {err.strerror or err}"
    except MemoryError:
        return MISUSE, "input: does not fit into the memory"
    except Exception as err:
        if os.environ.get("ACCELBENCH_TRACEBACK"):
            raise
        what = f"{type(err).__name__}: {err}"
        return MISUSE, f"error of the program: {what:.300} (ACCELBENCH_TRACEBACK=1 shows where)"


def _leave_pipe() -> None:
    """Whoever read us has gone: give the interpreter nothing to flush into the broken pipe."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextlib.contextmanager
def _warnings_held() -> Generator[HeldWarnings]:
    root, held = logging.getLogger(), HeldWarnings()
    root.addHandler(held)
    before = warnings.showwarning
    logging.captureWarnings(True)
    try:
        yield held
    finally:
        root.removeHandler(held)
        logging.captureWarnings(False)
        warnings.showwarning = before
