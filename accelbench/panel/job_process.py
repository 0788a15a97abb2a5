"""The process of one job: exports the tests, runs the command, says how it ended."""

import json
import subprocess
import sys
from pathlib import Path

from accelbench.panel.jobs import COMMON, KINDS
from errormodel.errors import WorkbenchError
from thermo.store.files import export_recorded
from thermo.store.store import open_store


def main() -> None:
    """Do what standard input asks for, in the present folder."""
    order = json.load(sys.stdin)
    log, code = Path("log.txt"), 2
    try:
        code = _run(order)
    except WorkbenchError as err:
        with log.open("a", encoding="utf-8") as file:
            file.write(f"\naccelbench: {err}\n")
    except Exception as err:
        with log.open("a", encoding="utf-8") as file:
            file.write(f"\nerror of the program: {type(err).__name__}: {err}\n")
    draft = Path(".done.json")
    draft.write_text(json.dumps({"code": code}), encoding="utf-8")
    draft.replace("done.json")


def _run(order: dict[str, object]) -> int:
    _, command, more = KINDS[str(order["kind"])]
    tests = order["tests"]
    assert isinstance(tests, list)
    files: list[str] = []
    with open_store(str(order["store"]), existing=True) as store:
        for number, test_id in enumerate(map(str, tests), 1):  # pyright: ignore[reportUnknownArgumentType]
            exported = export_recorded(store, test_id, Path(f"test_{number}.csv"))
            files += [str(e.path) for e in exported]
    words = [sys.executable, "-m", "accelbench", *command, *files, *more, *COMMON]
    with open("result.json", "wb") as out, open("log.txt", "ab") as err:
        return subprocess.run(words, stdout=out, stderr=err, check=False).returncode


if __name__ == "__main__":
    main()
