"""Values on their way into the database: what both SQLite and PostgreSQL keep unchanged."""

import json
import math
from collections.abc import Mapping
from typing import Any, cast

from errormodel.errors import StoreError
from thermo.store.records import QUANTITIES, ReadingRow

STATUSES = ("running", "interrupted", "finished", "failed")


def reading_values(test_id: str, run: int, row: ReadingRow) -> dict[str, Any]:
    """Return a reading as the database takes it; `StoreError` for what it must not hold."""
    values: dict[str, Any] = {"test_id": test_id, "run": int(run), "serial": row.serial}
    values |= {"slot": int(row.slot), "attempt": int(row.attempt), "segment": int(row.segment)}
    for name in QUANTITIES:
        values[name] = number_or_null(cast(float | None, getattr(row, name)))
    values["flag"] = plain_text(row.flag)
    infinite = [name for name in QUANTITIES if math.isinf(values[name] or 0.0)]
    if infinite or values["time_s"] is None:
        problem = f"{infinite[0]} is infinite" if infinite else "no time_s"
        raise StoreError(
            f"test {test_id} run {run}: {row.serial} slot {row.slot}: {problem}, "
            "expected a number; nothing was changed"
        )
    return values


def number_or_null(value: float | None) -> float | None:
    """SQLite keeps no NaN: a quantity without a value is NULL in both databases."""
    return None if value is None or math.isnan(value) else float(value)


def plain_text(text: str) -> str:
    """Neither database takes every text that Python has: no lone surrogate, no zero character."""
    return text.replace("\0", "\\0").encode("utf-8", "replace").decode()


def json_text(data: Mapping[str, Any]) -> str:
    """Return a mapping as JSON; what JSON does not know goes in as text."""
    return json.dumps(dict(data), default=str, sort_keys=True)


def check_status(status: str) -> str:
    """Return a status that there is."""
    if status not in STATUSES:
        raise StoreError(f"status {status!r}, expected one of {', '.join(STATUSES)}")
    return status
