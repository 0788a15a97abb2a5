"""The run-in verdicts as a JSON document and as text for people."""

from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import RenderableType

from accelbench.shell.console import number, table, value_and_sigma
from thermo.run_in.verdict import Relaxation, RunInVerdict, Spread, needed_text

DEFINITION = (
    "Each run is a cycle; K0 and K1 are those of each run fitted alone, at the reference "
    "temperature. Instability is the standard deviation (1 σ) between the runs at the beginning "
    "(before) and at the end (after); IEEE 528 calls the agreement of runs repeatability."
)

LAW_TEXT = {"exponential": "exponential exp(−k/κ)", "hyperbolic": "slow 1/(1 + k/κ)"}


def run_in_document(verdicts: Sequence[RunInVerdict]) -> list[dict[str, Any]]:
    """Return the verdicts for JSON, one object for each accelerometer."""
    return [_accelerometer(v) for v in verdicts]


def _accelerometer(v: RunInVerdict) -> dict[str, Any]:
    k0 = v.coefficients[0]
    return {
        "serial": v.serial,
        "before_sigma_ug": k0.before.sigma if k0.before else None,
        "after_sigma_ug": k0.after.sigma if k0.after else None,
        "cycles": v.cycles,
        "cycles_still_needed": list(v.cycles_needed),
        "cycles_still_needed_if_nothing_slow": None
        if v.needed_if_nothing_slow is None
        else list(v.needed_if_nothing_slow),
        "settled": v.settled,
        "settled_probability": v.settled_probability,
        "risk": 1 - v.confidence,
        "law": v.law,
        "other_law_needs": None if v.other_law_needs is None else list(v.other_law_needs),
        "log_evidence_hyperbolic_over_exponential": v.log_evidence_ratio,
        "jumps": [
            {"coefficient": j.coefficient, "cycle": j.cycle, "size": j.size, "unit": j.unit}
            for j in v.jumps
        ],
        "nothing_slow_assumed": v.nothing_slow,
        "not_excluded": list(v.not_excluded),
        "settled_probability_if_nothing_slow": v.settled_if_nothing_slow,
        "daily_swings": [
            {
                "coefficient": s.coefficient,
                "amplitude": s.amplitude,
                "unit": s.unit,
                "p_value": s.p_value,
            }
            for s in v.swings
        ],
        "scale": "fitted" if v.scale_fitted else "nominal",
        "sentence": v.sentence,
        "coefficients": {c.series.name: _coefficient(c) for c in v.coefficients},
    }


def _coefficient(c: Relaxation) -> dict[str, Any]:
    pairs = {"kappa_cycles": c.kappa, "amplitude": c.amplitude, "final": c.final}
    return {
        "unit": c.series.unit,
        "limit": c.series.limit,
        "by_cycle": c.series.values.tolist(),
        "by_cycle_sigma": c.series.sigmas.tolist(),
        **{
            name: {"value": value, "sigma": sigma}
            for name, (value, sigma) in {**pairs, "remaining_change": c.remaining}.items()
        },
        "before": _spread(c.before),
        "after": _spread(c.after),
        "estimate_sigma": c.estimate_sigma,
        "cycles_still_needed": list(c.cycles_needed),
    }


def _spread(spread: Spread | None) -> dict[str, Any] | None:
    if spread is None:
        return None
    return {"sigma": spread.sigma, "ci95": list(spread.ci95), "runs": spread.runs}


COLUMNS = (
    "serial",
    "coefficient",
    "instability before",
    "after",
    "times smaller",
    "relaxes over, cycles",
    "relaxed in all",
    "still to come",
    "limit",
    "cycles still needed",
)


def run_in_rows(verdicts: Sequence[RunInVerdict]) -> Iterator[tuple[str, ...]]:
    """Return a row for each coefficient, under `COLUMNS`."""
    for v in verdicts:
        for c in v.coefficients:
            unit = c.series.unit
            yield (
                v.serial,
                f"{c.series.name.upper()}, {unit}",
                _spread_text(c.before),
                _spread_text(c.after),
                _ratio(c),
                value_and_sigma(*c.kappa),
                value_and_sigma(*c.amplitude),
                value_and_sigma(*c.remaining),
                number(c.series.limit),
                needed_text(c.cycles_needed),
            )


def _spread_text(spread: Spread | None) -> str:
    if spread is None:
        return "–"
    low, high = spread.ci95
    if spread.sigma == 0:
        return f"< {number(high, 2)}"
    return f"{number(spread.sigma, 3)} ({number(low, 2)}…{number(high, 2)})"


def _ratio(c: Relaxation) -> str:
    if c.before is None or c.after is None or c.after.sigma == 0:
        return "–"
    return number(c.before.sigma / c.after.sigma, 2)


def law_sentence(v: RunInVerdict) -> str:
    """Tell which law of relaxation is used, and what the other one would ask for."""
    law, other = sorted(LAW_TEXT, key=lambda name: name != v.law)
    used = f"the {LAW_TEXT[law]} law is the likelier"
    slower = "a second relaxation, creep and a random walk beside it are " + (
        "assumed to be absent" if v.nothing_slow else "weighed in"
    )
    if v.other_law_needs is None:
        return f"{used}, the {LAW_TEXT[other]} one is excluded at odds of 20; {slower}"
    more = needed_text(v.other_law_needs)
    return f"{used}; under the {LAW_TEXT[other]} one, which is not excluded: {more}; {slower}"


def run_in_text(verdicts: Sequence[RunInVerdict]) -> Iterator[RenderableType]:
    """Tell the verdicts."""
    if not verdicts:
        return
    made = table(*COLUMNS, right=COLUMNS[2:-1], words=COLUMNS[-1:], keys=2)
    for row in run_in_rows(verdicts):
        made.add_row(*row)
    yield made
    ends = ", ".join(
        f"{v.serial} {v.coefficients[0].before.runs} runs at either end"
        for v in verdicts
        if v.coefficients[0].before is not None
    )
    if ends:
        yield (
            "instability: 1 σ between runs, its 95 % limits in brackets, or < the upper limit if "
            f"the runs show no instability; {ends}"
        )
    nominal = ", ".join(v.serial for v in verdicts if not v.scale_fitted)
    if nominal:
        yield f"{nominal}: the cycles do not determine K1; K0 in µg uses the nominal scale factor"
    for v in verdicts:
        yield f"{v.sentence}; {law_sentence(v)}"
