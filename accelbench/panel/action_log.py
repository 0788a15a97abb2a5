"""Log of the actions on the page: one JSON object a line with time and person."""

import json
import os
import threading
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeAlias

from accelbench.panel.settings import PanelSettings
from errormodel.errors import InputError
from thermo.store.database import parse_store_url

Detail: TypeAlias = str | int | float | bool | None


def log_path(settings: PanelSettings) -> Path:
    """Return the file of actions: beside a store that is a file, else beside the sequences."""
    parsed = parse_store_url(settings.store)
    if parsed.get_backend_name() == "sqlite":
        database = Path(str(parsed.database))
        return database.with_name(f"{database.name}.panel.jsonl")
    return settings.sequences / "panel.jsonl"


@dataclass(slots=True)
class ActionLog:
    """Log of actions: one JSON object a line with time and person; lines are only added."""

    path: Path
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def write(self, who: str, action: str, outcome: str, **details: Detail) -> None:
        """Add a line.

        Raises
        ------
        InputError
            If it cannot be written; then nothing is to be done.
        """
        told = {"utc": datetime.now(UTC).isoformat(timespec="milliseconds"), "who": who}
        line = json.dumps(told | {"action": action, "outcome": outcome} | details) + "\n"
        try:
            with self._lock:
                flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
                file = os.open(self.path, flags, 0o640)
                try:
                    os.write(file, line.encode())
                finally:
                    os.close(file)
        except OSError as err:
            raise InputError(self.path, "", f"cannot be written: {err.strerror}") from None

    def newest(self, count: int) -> list[dict[str, Detail]]:
        """Return the last lines, the newest first."""
        if not self.path.exists():
            return []
        with self.path.open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - 400 * count))
            lines = file.read().decode(errors="replace").splitlines()
        found: list[dict[str, Detail]] = []
        for line in reversed(lines):
            try:
                found.append(json.loads(line))
            except ValueError:  # the first piece of a line that was cut through
                continue
        return found[:count]
