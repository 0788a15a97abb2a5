"""Hold answers against keys. Nothing here is used before all answers are on disk."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from scipy import stats

STEADY = ("white", "white+OU")
REPEATABLE_OUTSIDE = ("periodic_in_temperature",)
# what a run that was not measured yet cannot be told of
NOT_PREDICTIVE = ("turn_on_offset", "bias_step", "bias_drift", "run_in", "warm_up")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """One data set: what was hidden, what was said, and what that is called."""

    name: str
    group: str
    protocol: str
    noise: str
    hidden: dict[str, dict[str, Any]]
    verdict: str
    bare: tuple[str, ...]  # names given without an alternative
    aliases: tuple[tuple[str, ...], ...]
    factor: str
    invisible: tuple[str, ...]
    heldout_over_noise: float | None  # rms after, over the noise that was really drawn
    heldout_over_floor: float | None  # the same over the floor that was stated
    seconds: float | None  # of processor time
    outcome: str

    @property
    def d(self) -> float:
        """The weakest hidden effect's strength; 0 where nothing is hidden."""
        return min((v["d"] for v in self.hidden.values()), default=0.0)

    @property
    def wrong_bare(self) -> bool:
        """Whether a name was given alone that is not hidden."""
        return any(name not in self.hidden for name in self.bare)


def score(name: str, key: dict[str, Any], answer: dict[str, Any]) -> Scored:
    """Score one data set.

    Parameters
    ----------
    name : str
    key : dict
        As `chamber_truth.write_set` makes it.
    answer : dict
        `json` (the command's document, or None), `seconds`, `exit`.
    """
    said: dict[str, Any] = answer["json"] or {"verdict": "failed"}
    aliases = tuple(tuple(names) for names in said.get("alias_sets") or ())
    aliased = {n for names in aliases for n in names}
    named = [e["name"] for e in said.get("effects") or ()]
    bare = tuple(n for n in named if n not in aliased)
    heldout_part: dict[str, Any] = said.get("heldout") or {}
    where: dict[str, Any] = said.get("where") or {}
    heldout: float | None = heldout_part.get("after_ug")
    drawn: float | None = key.get("noise_rms_ug")
    floor: float | None = said.get("floor_ug")
    return Scored(
        name=name,
        group=key["group"],
        protocol=key["protocol"],
        noise=key["noise"],
        hidden=key["hidden"],
        verdict=said["verdict"],
        bare=bare,
        aliases=aliases,
        factor=str(where.get("factor") or ""),
        invisible=tuple(map(str, said.get("invisible") or ())),
        heldout_over_noise=heldout / drawn if heldout and drawn else None,
        heldout_over_floor=heldout / floor if heldout and floor else None,
        seconds=answer["seconds"],
        outcome=outcome(key["group"], set(key["hidden"]), said["verdict"], bare, aliases),
    )


def outcome(
    group: str,
    hidden: set[str],
    verdict: str,
    bare: Sequence[str],
    aliases: Sequence[Sequence[str]],
) -> str:
    """Return what a verdict is called, given what was hidden."""
    if verdict == "failed":
        return "failed"
    if group in ("nothing", "invisible"):
        return "silent" if verdict == "nothing" else "false"
    if group == "outside":
        return "wrong name" if bare else "wrong alias" if aliases else verdict
    if any(n not in hidden for n in bare):
        return "wrong name"
    if any(not hidden & set(names) for names in aliases):
        return "wrong alias"
    found = set(bare) | {n for names in aliases for n in names if n in hidden}
    if found == hidden:
        return "alias" if aliases else "named"
    if found:
        return "in part"
    return "missed" if verdict == "nothing" else "unexplained"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rate:
    """An acceptance line: how many of how many, and what was asked."""

    text: str
    good: int
    of: int
    least: float | None = None  # share that must be reached
    most: float | None = None  # share that must not be exceeded

    @property
    def share(self) -> float:
        return self.good / self.of if self.of else float("nan")

    @property
    def limits(self) -> tuple[float, float]:
        """Clopper and Pearson's 95 % limits."""
        k, n = self.good, self.of
        if not n:
            return 0.0, 1.0
        low = float(stats.beta.ppf(0.025, k, n - k + 1)) if k else 0.0
        high = float(stats.beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
        return low, high

    @property
    def met(self) -> bool | None:
        """Whether the measured share is on the asked side; None where nothing is asked or known."""
        if not self.of or (self.least is None and self.most is None):
            return None
        return (
            self.share >= self.least if self.least is not None else self.share <= (self.most or 0)
        )


def count(
    text: str,
    sets: Iterable[Scored],
    good: Callable[[Scored], bool],
    *,
    least: float | None = None,
    most: float | None = None,
) -> Rate:
    chosen = list(sets)
    return Rate(text=text, good=sum(map(good, chosen)), of=len(chosen), least=least, most=most)


def right(s: Scored) -> bool:
    return s.outcome in ("named", "alias")


def acceptance(sets: Sequence[Scored]) -> list[Rate]:
    """Return the rates that the acceptance of the workflow asks for, in its order."""
    of = {g: [s for s in sets if s.group == g] for g in {s.group for s in sets}}
    nothing, single = of.get("nothing", []), of.get("single", [])
    library = [s for s in sets if s.group in ("single", "pair", "slow lag", "fast lag")]
    strange = [s for s in of.get("outside", []) if set(s.hidden) <= set(REPEATABLE_OUTSIDE)]
    fleeting = [s for s in of.get("outside", []) if s not in strange]
    predictive = [s for s in library if right(s) and not set(s.hidden) & set(NOT_PREDICTIVE)]
    return [
        count(
            "nothing hidden, white or white + OU: a false verdict",
            (s for s in nothing if s.noise in STEADY),
            lambda s: s.outcome != "silent",
            most=0.02,
        ),
        count(
            "nothing hidden, random walk or flicker: a false verdict",
            (s for s in nothing if s.noise not in STEADY),
            lambda s: s.outcome != "silent",
            most=0.05,
        ),
        count(
            "one effect, d ≥ 10: named or in an alias set",
            (s for s in single if s.d >= 9.99),
            right,
            least=0.98,
        ),
        count(
            "one effect, 7 ≤ d < 10: named or in an alias set",
            (s for s in single if s.d < 9.99),
            right,
            least=0.90,
        ),
        count(
            "an effect of the library hidden: a wrong bare name",
            library,
            lambda s: s.wrong_bare,
            most=0.01,
        ),
        count(
            "two effects: both found, none extra",
            of.get("pair", []),
            right,
            least=0.95,
        ),
        count(
            "outside the library, repeatable, d ≥ 20: said so, with the right factor",
            strange,
            lambda s: s.outcome == "unexplained_repeatable" and s.factor == "temperature",
            least=0.95,
        ),
        count(
            "outside the library, not repeatable: a bare name or alias set of the library",
            fleeting,
            lambda s: s.outcome in ("wrong name", "wrong alias"),
            most=0.01,
        ),
        count(
            "third order at 0°, ±90°, 180°: announced as invisible",
            of.get("invisible", []),
            lambda s: "third_order" in s.invisible,
            least=1.0,
        ),
        count(
            "lag without scale tempco, τ ≥ 60 s: named",
            of.get("slow lag", []),
            lambda s: s.outcome == "named",
            least=0.98,
        ),
        count(
            "lag without scale tempco, τ ≤ 15 s: alias with the rate bias",
            of.get("fast lag", []),
            lambda s: any(
                {"thermal_lag", "temperature_rate_bias"} <= set(names) for names in s.aliases
            ),
            least=0.90,
        ),
        count(
            "lag without scale tempco, τ ≤ 15 s: named rightly or in an alias set",
            of.get("fast lag", []),
            right,
            least=0.90,
        ),
        *_held_out(predictive, "found effects that a new run can show"),
        *_held_out(
            [s for s in nothing if s.outcome == "silent"],
            "nothing hidden or found: what the drift alone does",
            least=None,
        ),
    ]


def _held_out(sets: Sequence[Scored], what: str, least: float | None = 0.95) -> list[Rate]:
    """Return how often a run that was not fitted is predicted to the noise, under steady noise."""
    steady = [s for s in sets if s.noise in STEADY and s.heldout_over_noise]
    return [
        count(
            f"white, white + OU: held-out rms after ≤ 1.05 of the floor stated ({what})",
            steady,
            lambda s: (s.heldout_over_floor or math.inf) <= 1.05,
            least=least,
        ),
        count(
            f"the same, of the noise drawn ({what})",
            steady,
            lambda s: (s.heldout_over_noise or math.inf) <= 1.05,
            least=least,
        ),
    ]
