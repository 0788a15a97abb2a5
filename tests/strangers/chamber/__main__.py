"""Set accelbench against simulated chamber tests: `python -m tests.strangers.chamber`."""

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from tests.strangers.chamber.judge import Verdict, judge
from tests.strangers.chamber.repeats import judge_run_in, judge_stability, repeated, run_in
from tests.strangers.chamber.setups import draw

COMMANDS: dict[str, Callable[[int, int, Path], tuple[str, Verdict]]] = {
    "fit": lambda s, n, at: (" + ".join((how := draw(s, n)).kinds), judge(how, at)),
    "stability": lambda s, n, at: ((made := repeated(s, n)).kind, judge_stability(made, at)),
    "runin": lambda s, n, at: ((made := run_in(s, n)).kind, judge_run_in(made, at)),
}


def main() -> int:
    """Run the set-ups asked for, tell each one's worst figure, and list those wrong in silence."""
    parser = argparse.ArgumentParser(prog="tests.strangers.chamber", description=__doc__)
    parser.add_argument("--command", choices=list(COMMANDS), default="fit")
    parser.add_argument("--set-ups", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder that keeps all files")
    asked = parser.parse_args()
    folder = asked.out or Path(tempfile.mkdtemp(prefix="chamber-"))
    silent: list[str] = []
    for number in range(asked.first, asked.first + asked.set_ups):
        kind, found = COMMANDS[asked.command](asked.seed, number, folder / str(number))
        name, z = found.worst
        line = f"{number} {kind}: exit {found.fit_code} {found.apply_code}; {name} {z:+.1f} sigma"
        said = f"; said: {found.pointers[0][:90]}" if found.pointers else ""
        sys.stdout.write(f"{line}{said}\n")
        sys.stdout.flush()
        if found.silent:
            silent.append(line)
    total = f"{len(silent)} of {asked.set_ups} wrong in silence; files in {folder}"
    sys.stdout.write("\n".join([total, *silent, ""]))
    return 1 if silent else 0


raise SystemExit(main())
