"""Start the command, when the packages beside this one are its own.

`thermo` and `drivers` are names of other packages on the index as well. One that is installed over
ours would be imported in its place, and fail somewhere inside.
"""

import importlib.util
import os
import sys
from pathlib import Path

PACKAGES = ("errormodel", "drivers", "thermo", "sinscal")
MISUSE, STOPPED = 2, 130
# what tells the libraries for matrices how many threads to take, when they are imported
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "GOTO_NUM_THREADS")


def foreign_packages(home: Path | None = None) -> dict[str, str]:
    """Return the packages that are not accelbench's own, with the place where each was found.

    Parameters
    ----------
    home : Path, optional
        The folder that holds accelbench.

    Returns
    -------
    dict
        Empty when all four are beside accelbench; a package that is nowhere has the place "".
    """
    home = home or Path(__file__).resolve().parents[1]
    found: dict[str, str] = {}
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        origin = "" if spec is None or spec.origin is None else spec.origin
        is_own = origin and Path(origin).resolve().parent == home / name
        # py.typed goes with ours: a package of the same name may have been written over it
        if not (is_own and (home / name / "py.typed").exists()):
            found[name] = origin
    return found


def main() -> int:
    """Run the command; exit code 2 with one line when a package is somebody else's."""
    for name, place in foreign_packages().items():
        problem = f"is a different package, at {place}" if place else "is missing"
        sys.stderr.write(
            f"accelbench: package {name} {problem}; install accelbench in an environment of its "
            "own: pipx install accelbench\n"
        )
        return MISUSE
    take_one_thread()
    try:
        from accelbench.cli import main as run

        return run()
    except KeyboardInterrupt:  # while the first modules are being imported
        sys.stderr.write("accelbench: stopped\n")
        return STOPPED


def take_one_thread() -> None:
    """Let products of matrices take one thread, unless the user has said how many.

    The matrices here are long and narrow: on a busy machine two threads wait for one another, and
    a search took seven times as long.
    """
    if not any(name in os.environ for name in THREADS):
        for name in THREADS[:3]:
            os.environ[name] = "1"
