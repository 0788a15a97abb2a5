"""Ask the workflow about a folder, as a black box: its command in a process of its own."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# the command, and what the processor spent on it: time by the clock is the machine's other work too
ENTRY = """
import atexit, sys, time
atexit.register(lambda: sys.stderr.write(f"\\ncpu_s {time.process_time():.3f}\\n"))
from accelbench.cli import main
sys.exit(main(sys.argv[1:]))
"""
LIMIT_S = 600.0  # for one answer


def ask_workflow(
    folder: Path,
    program: Path,
    *options: str,
    kind: str = "thermal",
    files: Sequence[str] = ("run.csv",),
) -> dict[str, Any]:
    """Run the command on a data set.

    Parameters
    ----------
    folder : Path
        Where the recorded runs lie; nothing else does.
    program : Path
        Root of the program that answers.
    *options : str
        Further options of the command.
    kind : {"thermal", "rig"}
    files : sequence of str
        Names in the folder.

    Returns
    -------
    dict
        `json` (the document, None if there is none), `exit`, `stderr` (its end), `seconds` (of
        processor time, None if it did not end).
    """
    environment = {
        **os.environ,
        "PYTHONPATH": str(program),
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    words = [sys.executable, "-c", ENTRY, "discrepancy", kind, *files, "--json", *options]
    try:
        done = subprocess.run(
            words,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        why = f"no answer in {LIMIT_S:g} s"
        return {"json": None, "exit": None, "stderr": why, "seconds": None}
    try:
        document = json.loads(done.stdout)
    except json.JSONDecodeError:
        document = None
    said, _, seconds = done.stderr.rpartition("\ncpu_s ")
    return {
        "json": document,
        "exit": done.returncode,
        "stderr": said[-2000:],
        "seconds": float(seconds),
    }
