"""The command `accelbench`: parses, calls one function, shows what came out.

Exit codes: 0 done; 1 a criterion failed, or a test was stopped; 2 misuse or bad input, told in one
line on standard error, with nothing written; 130 the work was stopped by Ctrl-C.
"""

import contextlib
import json
import logging
import os
import sys
import warnings
from collections.abc import Generator, Sequence

import click

from accelbench.shell.advice import advice
from accelbench.shell.lazy import LazyGroup
from accelbench.shell.surroundings import DONE, MISUSE, STOPPED, Shell
from accelbench.shell.terminal import Terminal, open_closed_descriptors
from drivers.errors import InstrumentError
from errormodel.errors import InputError, WorkbenchError

# name: module, attribute, what it does
COMMANDS = {
    "demo": ("demo.command", "demo", "The whole job on emulated instruments."),
    "run": ("run.command", "run", "Run a chamber test sequence."),
    "make-safe": ("run.make_safe_command", "make_safe", "Put a chamber into its safe condition."),
    "control": ("control.group", "control", "Pause, resume or abort a running test; the queue."),
    "panel": ("panel.command", "panel", "Plan, start and watch tests in a browser."),
    "panel-user": ("panel.command", "panel_user", "Add a user of the operator's page."),
    "runs": ("run.store_commands", "runs", "List the tests in a store."),
    "export": ("run.store_commands", "export", "Write a test of a store as a recorded run."),
    "import": ("fit.command", "import_", "Convert a log recorded by others into a recorded run."),
    "fit": ("fit.command", "fit", "Fit each accelerometer's error model over temperature."),
    "runin": (
        "run_in.command",
        "runin",
        "Test whether a run-in has settled, or how many cycles it still needs.",
    ),
    "compensate": ("fit.command", "compensate", "Apply a model to recorded runs."),
    "stability": (
        "stability.command",
        "stability",
        "Compare runs: repeatability of each coefficient.",
    ),
    "rig": ("rig.group", "rig", "Plan, simulate and evaluate the rig calibration of a SINS."),
    "combine": ("combine.command", "combine", "Calibrate a SINS with its chamber models."),
    "discrepancy": (
        "discrepancy.group",
        "discrepancy",
        "Name the effect that a model lacks, and add it.",
    ),
    "examples": ("examples", "examples", "Write the example files into a folder."),
    "emulate": ("run.store_commands", "emulate", "Serve the instruments of a station file."),
}


class _StoppedError(Exception):
    """Ctrl-C, without the line that click adds to it."""


class _PipeError(Exception):
    """A broken pipe, without the exit that click makes of it; never that of a standard stream."""


class _Commands(LazyGroup):
    """The program's commands; how they end is told by `main`."""

    table = COMMANDS

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise _StoppedError from None
        except BrokenPipeError as err:
            raise _PipeError(f"{err.filename or 'pipe'}: {err.strerror or err}") from err


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="accelbench")
def accelbench() -> None:
    """Characterise accelerometers over temperature, and compensate them.

    Every command takes --json: one JSON document on standard output and nothing else. Exit codes:
    0 done, 1 a criterion failed, 2 misuse or bad input, 130 stopped.
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
        0 done, 1 a criterion failed, 2 misuse or bad input, 130 stopped by Ctrl-C.
    """
    if argv is None:
        open_closed_descriptors()
    given = list(sys.argv[1:] if argv is None else argv)
    with Terminal() as terminal, _warnings_held(Shell(terminal)) as shell:
        code, complaint = _run(given, shell)
        if code != MISUSE:
            shell.held.go_live()
        if complaint:
            said = " ".join(complaint.split())
            click.echo(f"accelbench: {said}", err=True)
            if "--json" in given:
                click.echo(json.dumps({"error": said, "exit_code": code}, ensure_ascii=False))
        return shell.end(code, program=argv is None)


def _run(argv: list[str], shell: Shell) -> tuple[int, str]:
    """Return the exit code, and a complaint when there is one."""
    try:
        result = accelbench.main(
            args=argv, prog_name="accelbench", standalone_mode=False, obj=shell
        )
        return (result if isinstance(result, int) else DONE), ""
    except click.exceptions.NoArgsIsHelpError as err:
        click.echo(err.ctx.get_help())
        group = err.ctx.command
        names = group.list_commands(err.ctx) if isinstance(group, click.Group) else []
        return MISUSE, f"no command given, expected one of {', '.join(names)}"
    except click.UsageError as err:
        where = err.ctx.command_path.removeprefix("accelbench").strip() if err.ctx else ""
        return MISUSE, ": ".join(part for part in (where, err.format_message()) if part)
    except InputError as err:
        helps = advice(err.source, argv)
        return MISUSE, f"{err}; {helps}" if helps else str(err)
    except (WorkbenchError, InstrumentError) as err:
        return MISUSE, str(err)
    except (_StoppedError, KeyboardInterrupt, click.Abort):
        return STOPPED, "stopped"
    except _PipeError as err:
        return MISUSE, str(err)
    except OSError as err:
        return MISUSE, f"{err.filename or 'file'}: {err.strerror or err}"
    except MemoryError:
        return MISUSE, "input: does not fit into the memory"
    except Exception as err:
        if os.environ.get("ACCELBENCH_TRACEBACK"):
            raise
        what = f"{type(err).__name__}: {err}"
        return MISUSE, f"error of the program: {what:.300} (ACCELBENCH_TRACEBACK=1 shows where)"


@contextlib.contextmanager
def _warnings_held(shell: Shell) -> Generator[Shell]:
    root, held = logging.getLogger(), shell.held
    root.addHandler(held)
    before = warnings.showwarning
    logging.captureWarnings(True)
    try:
        yield shell
    finally:
        root.removeHandler(held)
        logging.captureWarnings(False)
        warnings.showwarning = before
