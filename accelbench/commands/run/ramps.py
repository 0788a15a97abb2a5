"""The verdicts on a test's ramps, summed up."""

from collections.abc import Iterator, Sequence

from accelbench.shell.console import number
from thermo.station.checks.uniformity import RampVerdict

UNJUDGED = "too few readings for a verdict"


def ramp_lines(verdicts: Sequence[RampVerdict], *, verbose: bool) -> Iterator[str]:
    """Tell how many ramps were uniform, each that was not, and how they compare with service.

    Parameters
    ----------
    verdicts : sequence of RampVerdict
    verbose : bool
        Tell every ramp.
    """
    if not verdicts:
        return
    judged = [v for v in verdicts if v.readings]
    passed = [v for v in judged if v.passed]
    worst = max((_off_percent(v) for v in judged), default=None)
    parts: list[str] = []
    if worst is not None:
        parts.append(
            f"{len(passed)} of {len(judged)} ramps uniform, the mean rate at worst "
            f"{number(worst, 2)} % from the commanded one"
        )
    if unjudged := len(verdicts) - len(judged):
        parts.append(f"{unjudged} ramps had {UNJUDGED}")
    yield "; ".join(parts if verbose else [*parts, "-v tells each"])
    for v in verdicts:
        if verbose or (v.readings and not v.passed):
            yield f"  {v.sentence}"
    yield from _against_service(judged)


def _off_percent(v: RampVerdict) -> float:
    return 100.0 * abs(v.measured / v.commanded - 1.0) if v.commanded else 0.0


def _against_service(judged: Sequence[RampVerdict]) -> Iterator[str]:
    """Say once for each rate how the ramps compare with the SINS's own warming."""
    told: dict[tuple[float, float], float] = {}
    for v in judged:
        if v.mismatch_percent is not None and v.sins_rate is not None:
            told.setdefault((v.commanded, v.sins_rate), v.mismatch_percent)
    for (commanded, sins_rate), percent in told.items():
        faster = "faster" if percent > 0 else "slower"
        yield (
            f"ramps of {number(commanded, 3)} °C/min are {number(abs(percent), 3)} % {faster} "
            f"than the self-heating of the SINS, at {number(sins_rate, 3)} °C/min (mismatch, by "
            f"[uniformity] of the sequence): errors that depend on the rate are measured at a "
            f"different rate from service"
        )
