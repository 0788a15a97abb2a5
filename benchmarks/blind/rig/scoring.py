"""What is asked of the workflow on rig runs."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.blind.rig.sets import PARTS
from benchmarks.blind.rig.strangers import STRANGERS
from benchmarks.blind.scoring import Rate, Scored, count, right
from benchmarks.blind.summary import Subject

# what comes again when the programme is repeated, and the factors that show it: a SINS that warms
# while it runs shows temperature and time as one
REPEATABLE = {
    "phase_vibration": ("rotation phase",),
    "periodic_in_temperature": ("temperature", "time in run", "cycle"),
}


def rig_acceptance(sets: Sequence[Scored]) -> list[Rate]:
    """Return the rates asked for: six effects by strength, the rest of the library, silence."""
    of = {g: [s for s in sets if s.group == g] for g in {s.group for s in sets}}
    single, pair, other = (of.get(g, []) for g in ("single", "pair", "other"))
    strange = of.get("outside", [])
    shaking = [s for s in strange if set(s.hidden) == {"phase_vibration"}]
    return [
        count(
            "nothing hidden: a false verdict",
            of.get("nothing", []),
            lambda s: s.outcome != "silent",
            most=0.02,
        ),
        count(
            "one of six effects, d ≥ 10: named or in an alias set",
            (s for s in single if s.d >= 9.99),
            right,
            least=0.98,
        ),
        count(
            "one of six effects, 7 ≤ d < 10: named or in an alias set",
            (s for s in single if s.d < 9.99),
            right,
            least=0.90,
        ),
        count(
            "one of the other effects of the library, d ≥ 10: named or in an alias set",
            other,
            right,
            least=0.98,
        ),
        count(
            "an effect of the library hidden: a wrong bare name",
            [*single, *other, *pair],
            lambda s: s.wrong_bare,
            most=0.01,
        ),
        count("two effects: both found, none extra", pair, right, least=0.95),
        count(
            "a vibration that follows the rotation phase, d ≥ 20: said so, with that factor",
            shaking,
            lambda s: s.outcome == "unexplained_repeatable" and _factor_right(s),
            least=0.95,
        ),
        count(
            "outside the library: said to be unexplained",
            strange,
            lambda s: s.outcome.startswith("unexplained"),
        ),
        count(
            "outside the library: a bare name of the library",
            strange,
            lambda s: s.outcome == "wrong name",
            most=0.01,
        ),
    ]


def _factor_right(s: Scored) -> bool:
    return any(s.factor in REPEATABLE.get(name, ()) for name in s.hidden)


RIG = Subject(
    library=tuple(PARTS),
    outside=tuple(STRANGERS),
    acceptance=rig_acceptance,
    groups=("single", "other", "pair"),
    conditions=("programme", "mode"),
    not_alone=("pair",),
    template=Path(__file__).with_name("page.template.md"),
)
