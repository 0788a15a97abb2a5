"""The program in a process of its own, in a folder of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


def ran(folder: Path, *arguments: str) -> tuple[Path, Any, str]:
    """Return the folder, the document on standard output, and what went to standard error."""
    made = subprocess.run(
        [sys.executable, "-c", "import sys; from accelbench.cli import main; sys.exit(main())",
         *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    return folder, json.loads(made.stdout), made.stderr
