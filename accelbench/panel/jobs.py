"""Work on stored tests that the page asks for: a process each, a folder of results each.

A folder holds `job.json` (what was asked, by whom), the recorded runs, the command's files, its
standard error as `log.txt`, and at the end `done.json` with the exit code. The process outlives the
page.
"""

import json
import re
import secrets
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from accelbench.panel.settings import PanelSettings
from errormodel.errors import InputError
from thermo.safety.processes import is_alive, process_start
from thermo.store.database import parse_store_url

# name: title, and the command's words after the recorded runs
KINDS: Mapping[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "fit": ("Fit", ("fit",), ("--out", "model.json")),
    "stability": ("Stability", ("stability",), ()),
    "discrepancy": ("Missing effect", ("discrepancy", "thermal"), ("--out", "larger.toml")),
}
COMMON = ("--report", "report", "--json")
FOLDER = re.compile(r"\d{8}T\d{6}-[0-9a-f]{4}")
FILE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
SHOWN = ("report.html", "model.json", "larger.toml", "larger.json", "result.json", "log.txt")
MOST_TESTS = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class JobState:
    """A job and how far it has come.

    Attributes
    ----------
    name : str
        Of its folder.
    kind, who, asked_utc : str
    tests : tuple of str
    code : int or None
        Exit code of the command; None while it runs, or if its process is gone.
    running : bool
    last : str
        The last line that the command has told.
    files : tuple of str
        Names that can be had.
    """

    name: str
    kind: str
    who: str
    asked_utc: str
    tests: tuple[str, ...]
    code: int | None
    running: bool
    last: str
    files: tuple[str, ...]


def results_path(settings: PanelSettings) -> Path:
    """Return the folder of results: beside a store that is a file, else beside the sequences."""
    parsed = parse_store_url(settings.store)
    if parsed.get_backend_name() == "sqlite":
        database = Path(str(parsed.database)).resolve()
        return database.with_name(f"{database.name}.results")
    return settings.sequences.resolve() / "results"


@dataclass(frozen=True, slots=True)
class Jobs:
    """The jobs of a store.

    Parameters
    ----------
    root : Path
        Folder of results.
    store : str
        URL of the store.
    """

    root: Path
    store: str

    def start(self, kind: str, tests: tuple[str, ...], who: str) -> str:
        """Start a job and return its name.

        Raises
        ------
        InputError
            If the kind is none, or there are no tests or too many.
        """
        if kind not in KINDS:
            raise InputError(kind, "", f"expected one of {', '.join(KINDS)}")
        if not 1 <= len(tests) <= MOST_TESTS:
            raise InputError("tests", "", f"tick 1 to {MOST_TESTS} tests")
        name = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{secrets.token_hex(2)}"
        folder = self.root / name
        try:
            folder.mkdir(parents=True)
        except OSError as err:
            raise InputError(folder, "", f"cannot be made: {err.strerror}") from None
        now = datetime.now(UTC).isoformat(timespec="seconds")
        asked = {"kind": kind, "tests": list(tests), "who": who, "asked_utc": now}
        _write(folder / "job.json", asked)
        process = subprocess.Popen(
            [sys.executable, "-m", "accelbench.panel.job_process"],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        assert process.stdin is not None
        with suppress(BrokenPipeError), process.stdin as pipe:
            pipe.write(json.dumps(asked | {"store": self.store}).encode())
        _write(folder / "process.json", {"pid": process.pid, "start": process_start(process.pid)})
        return name

    def states(self) -> tuple[JobState, ...]:
        """Return all jobs, the newest first."""
        if not self.root.is_dir():
            return ()
        names = sorted(p.name for p in self.root.iterdir() if FOLDER.fullmatch(p.name))
        found = [self._state(name) for name in reversed(names)]
        return tuple(one for one in found if one is not None)

    def file(self, job: str, name: str) -> Path:
        """Return the path of a result's file.

        Raises
        ------
        InputError
            If there is none of this name in that job's folder.
        """
        if FOLDER.fullmatch(job) and FILE.fullmatch(name):
            for folder in (self.root / job, self.root / job / "report"):
                path = folder / name
                if path.is_file() and path.resolve().parent == folder.resolve():
                    return path
        raise InputError(f"{job}/{name}", "", "no such result")

    def models(self) -> list[tuple[JobState, dict[str, Any]]]:
        """Return every fitted model of an accelerometer, as its file has it."""
        found: list[tuple[JobState, dict[str, Any]]] = []
        for job in self.states():
            if job.kind != "fit" or job.code not in (0, 1):
                continue
            model = _read(self.root / job.name / "model.json")
            found += [(job, one) for one in model.get("accelerometers", [])]
        return found

    def _state(self, name: str) -> JobState | None:
        folder = self.root / name
        asked, done = _read(folder / "job.json"), _read(folder / "done.json")
        if asked.get("kind") not in KINDS:
            return None
        process = _read(folder / "process.json")
        alive = bool(process) and is_alive(process["pid"], process["start"])
        names = {p.name for p in folder.iterdir() if FILE.fullmatch(p.name)}
        names |= {"report.html"} if (folder / "report/report.html").is_file() else set()
        tables = sorted(n for n in names if n.endswith((".csv", ".parquet")))
        return JobState(
            name=name,
            kind=asked["kind"],
            who=asked["who"],
            asked_utc=asked["asked_utc"],
            tests=tuple(asked["tests"]),
            code=done.get("code"),
            running=not done and alive,
            last=_last_line(folder / "log.txt"),
            files=(*(n for n in SHOWN if n in names), *tables),
        )


def _write(path: Path, content: Mapping[str, Any]) -> None:
    draft = path.with_name(f".{path.name}")
    draft.write_text(json.dumps(content), encoding="utf-8")
    draft.replace(path)


def _read(path: Path) -> dict[str, Any]:
    """Return a JSON object; an empty one if there is none yet."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return cast(dict[str, Any], found) if isinstance(found, dict) else {}


def _last_line(path: Path) -> str:
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 2000))
            lines = re.split(r"[\r\n]+", file.read().decode(errors="replace"))
    except OSError:
        return ""
    return next((line.strip() for line in reversed(lines) if line.strip()), "")
