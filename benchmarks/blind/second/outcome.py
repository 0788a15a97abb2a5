"""What one answer is called, given what was hidden in the accelerometer it is about."""

import re
from dataclasses import dataclass, field
from typing import Any

from benchmarks.blind.second.library import NAMES

# words of a factor, so that another wording of the same thing is right as well; first match counts
FACTOR_WORDS = (
    ("chamber_minus_case", r"chamber|heat.?flow|air"),
    ("last_move", r"(size|direction|sense).*move|last_move(?!.*since)|move_(direction|size)"),
    ("since_move", r"(since|after).*move|settl"),
    ("position_before", r"position.*(before|previous)|(before|previous|last).*position"),
    ("since_ramp_change", r"(since|after).*(ramp|rate|hold|change)"),
    ("turning_temperature", r"turn(ed|ing)"),
    ("rest_before_run", r"rest"),
    ("hour", r"hour|daily|time.of.day|day"),
    ("time_in_run", r"time.in.run"),
    ("position", r"position|rotation.phase"),
    ("direction", r"direction|heating|branch"),
    ("rate", r"rate"),
    ("temperature", r"temperature"),
    ("run", r"^run$"),
    ("time", r"^time$"),
)
RIGHT = ("exact", "alias")


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One accelerometer of a set: truth, answer, and what that is called."""

    seed: int
    serial: str
    group: str  # nulls, companion, library, pairs, outside
    kind: str  # names of what is hidden, joined
    beside: bool  # outside: a library effect stands beside it
    d: float
    protocol: dict[str, Any] = field(repr=False)
    noise: str
    present: str
    verdict: str
    bare: tuple[str, ...]
    aliases: tuple[tuple[str, ...], ...]
    factors: tuple[str, ...]
    left: bool  # the answer says that something is left
    outcome: str
    told: bool  # outside: said to be unexplained, in whole or part, or named rightly
    factor_right: bool
    bare_wrong: bool
    weight: float | None
    predictive: bool  # a new run shows what is hidden, or would
    unseen: float | None  # noise and what is off beside its mean, over the noise, of that run
    cpu_s: float | None


def factor_of(words: str) -> str:
    """Return the plain word of a factor as the command writes it; itself where none fits."""
    low = words.lower()
    return next((name for name, form in FACTOR_WORDS if re.search(form, low)), low)


def cases_of(record: dict[str, Any]) -> list[Case]:
    """Return the cases of a record of `run`, one an accelerometer."""
    key, answer = record["key"], record["answer"]
    document = answer["json"] or {}
    by_serial = {a.get("serial"): a for a in document.get("accelerometers") or [document]}
    shared = document.get("shared") or []
    cases = []
    for told in key["accelerometers"]:
        said = by_serial.get(told["serial"])
        if not said or "verdict" not in said:
            said = {"verdict": "failed"}
        said = {**said, "shared": shared}
        cases.append(_case(key, told, said, answer, record["unseen_ug"]))
    return cases


def _case(
    key: dict[str, Any],
    told: dict[str, Any],
    said: dict[str, Any],
    answer: dict[str, Any],
    unseen_ug: dict[str, float] | None,
) -> Case:
    hidden = told["hidden"]
    group = key["group"] if told["carrier"] else "library" if hidden else "companion"
    aliases = tuple(tuple(names) for names in said.get("alias_sets") or ())
    among = {name for names in aliases for name in names}
    bare = tuple(e["name"] for e in said.get("effects") or () if e["name"] not in among)
    left = bool(said.get("something_left")) or said["verdict"].startswith("unexplained")
    factors = _factors(said)
    stranger = next((h for h in hidden if h["outside"]), None)
    names = {h["name"] for h in hidden if not h["outside"]}
    if stranger:
        result = _outside(stranger, names, said["verdict"], bare, aliases, left)
    else:
        result = _library(names, said["verdict"], bare, aliases), left, False
    predictive = told["carrier"] and key["predictive"]
    return Case(
        seed=key["seed"],
        serial=told["serial"],
        group=group,
        kind="+".join(h["name"] for h in hidden) or "nothing",
        beside=bool(stranger and names),
        d=min((h["d"] for h in hidden), default=0.0) if not stranger else stranger["d"],
        protocol=key["protocol"],
        noise=key["noise"]["label"],
        present=key["present"],
        verdict=said["verdict"],
        bare=bare,
        aliases=aliases,
        factors=factors,
        left=left,
        outcome=result[0],
        told=result[1],
        factor_right=bool(stranger and set(factors) & set(stranger["factors"])),
        bare_wrong=result[2],
        weight=_weight(said),
        predictive=predictive,
        unseen=_over_noise(key["noise_rms_ug"], unseen_ug) if predictive and unseen_ug else None,
        cpu_s=answer["cpu_s"],
    )


def _over_noise(noise_ug: float, off: dict[str, float]) -> float:
    """Return what an unseen run would show over its noise; the level of a run is the noise's."""
    return (1 + (off["rms"] ** 2 - off["mean"] ** 2) / noise_ug**2) ** 0.5


def _factors(said: dict[str, Any]) -> tuple[str, ...]:
    """Return the factors the answer points at: where it is, and where the rest is, if said."""
    found: list[str] = []
    for part in ("where", "rest", "left"):
        where = said.get(part)
        if isinstance(where, dict):
            for name in ("factor", "factors", "second_factor"):
                value: Any = where.get(name)
                found += [value] if isinstance(value, str) else value or []
    return tuple(dict.fromkeys(factor_of(str(word)) for word in found))


def _weight(said: dict[str, Any]) -> float | None:
    """Return the posterior weight of the verdict, where the answer has one."""
    for name in ("weight", "posterior_weight", "verdict_weight", "posterior"):
        value = said.get(name)
        if isinstance(value, int | float):
            return float(value)
    return None


def _library(
    hidden: set[str],
    verdict: str,
    bare: tuple[str, ...],
    aliases: tuple[tuple[str, ...], ...],
) -> str:
    """Return the outcome where all that is hidden, if anything, has a name."""
    if verdict == "failed":
        return "failed"
    if not hidden:
        return "silent" if verdict == "nothing" else "false"
    extra = [n for n in bare if n not in hidden]
    astray = [names for names in aliases if not hidden & set(names)]
    found = hidden & (set(bare) | {n for names in aliases for n in names})
    if found == hidden:
        return "too many" if extra or astray else "alias" if aliases else "exact"
    if extra or astray:
        return "wrong"
    if found:
        return "in part"
    return "missed" if verdict == "nothing" else "unexplained"


def _outside(
    stranger: dict[str, Any],
    hidden: set[str],
    verdict: str,
    bare: tuple[str, ...],
    aliases: tuple[tuple[str, ...], ...],
    left: bool,
) -> tuple[str, bool, bool]:
    """Return outcome, whether it was told, and whether a bare name explains less than half."""
    if verdict == "failed":
        return "failed", False, False
    named = [n for names in (bare, *aliases) for n in names if n not in NAMES]
    words = "|".join(stranger["names"])
    right = bool(words) and any(re.search(words, n.lower()) for n in named)
    others = [n for n in bare if n in NAMES and n not in hidden]
    wrong = verdict == "named" or (verdict == "alias" and bool(others))
    wrong = wrong and any(stranger["shares"].get(n, 0.0) < 0.5 for n in others)
    if wrong:
        return "wrong name", left or right, True
    if right:
        return "named", True, False
    if left:
        return "told", True, False
    if verdict == "nothing":
        return "silent", False, False
    astray = any(not hidden & set(n) for n in aliases)
    return ("half a name" if others else "wrong alias" if astray else "only beside"), False, False
