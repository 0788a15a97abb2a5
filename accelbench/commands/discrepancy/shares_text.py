"""The shares of the excess, as JSON and in words."""

from collections.abc import Iterator
from typing import Any

from errormodel.discrepancy.investigation import Conclusion
from errormodel.discrepancy.shares import Shares


def shares_document(found: Conclusion[Any, Any], shares: Shares) -> dict[str, Any]:
    """Return the shares as JSON: of names that do not stand under `partial`."""
    partial = not found.judgement.names_stand
    return {
        "excess_chi2": shares.excess,
        "partial": [{"name": n, "share": s} for n, s in shares.names.items()] if partial else [],
        "rest": {"factor": shares.rest, "share": shares.rest_share} if shares.rest else None,
    }


def share_lines(found: Conclusion[Any, Any], shares: Shares) -> Iterator[str]:
    """Say what the names explain, and what the rest follows."""
    told = [f"{n} explains {_percent(s)} of the excess" for n, s in shares.names.items()]
    rest = f"the rest follows {shares.rest}" if shares.rest else ""
    if found.judgement.names_stand:
        if rest or len(told) > 1:
            yield _sentence([", ".join(told), rest])
    elif told:
        yield _sentence([", ".join(told), rest])
        yield "These names explain too little of it to stand."


def _sentence(parts: list[str]) -> str:
    return "; ".join(part for part in parts if part) + "."


def _percent(share: float) -> str:
    return f"{100.0 * share:.{1 if share < 0.01 else 0}f} %"
