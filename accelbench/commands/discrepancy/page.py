"""The report of a verdict: one page a metrologist would sign, and its figures."""

from collections.abc import Sequence

from accelbench.commands.discrepancy.figures import draw_verdict
from accelbench.commands.discrepancy.text import VERDICT_WORDS, shared_lines, verdict_lines
from accelbench.commands.discrepancy.verdict_page import (
    VerdictPage,
    render_verdicts,
    rival_rows,
)
from accelbench.commands.fit.text import value_and_sigma
from accelbench.shell.console import number
from accelbench.shell.page import measured_on
from thermo.discrepancy.find import Discrepancy
from thermo.discrepancy.smallest import smallest_nameable
from thermo.library.effects import ThermalEffect
from thermo.recording.files import RecordedRuns

CONVENTIONS = (
    "The noise is estimated separately in each simulated run.",
    "Held out: each run is predicted from the others; the effect is selected again without it.",
    "Noise alone: the residual of a held-out run if no effect were missing.",
)


def render_discrepancy(found: Sequence[Discrepancy], runs: RecordedRuns) -> dict[str, bytes]:
    """Return a report's files by name, without writing any.

    Parameters
    ----------
    found : sequence of Discrepancy
    runs : RecordedRuns
        Runs that they were found in.

    Returns
    -------
    dict of str to bytes
    """
    title = f"What is missing from the model of {', '.join(d.serial for d in found):.80}"
    return render_verdicts(
        title, runs.run_ids, [_page(d) for d in found], CONVENTIONS, measured_on(runs)
    )


def _page(d: Discrepancy) -> VerdictPage:
    sizes = {n: f"{number(p.value, 2)} {p.unit}" for n, p in smallest_nameable(d).items()}
    return VerdictPage(
        name=d.serial,
        verdict=VERDICT_WORDS[d.verdict],
        lines=(*verdict_lines(d), *shared_lines([d])),
        effects=tuple(
            (e.name, name, value_and_sigma(p.value, p.sigma), p.unit)
            for e in d.effects
            for name, p in e.parameters.items()
        ),
        pictures=tuple(draw_verdict(d)),
        rivals=tuple(rival_rows(d, _library(d), sizes, d.source.holds_some)),
        noise=_noise(d),
    )


def _library(d: Discrepancy) -> list[ThermalEffect]:
    """Return the library that was searched: a shape came after it."""
    return [e for e in d.source.effects if d.shape is None or e.name != d.shape.name]


def _noise(d: Discrepancy) -> str:
    noise = d.floor.noise
    text = f"{number(noise.white, 3)} µg white in a block mean"
    if noise.family == "white":
        return text
    slow = ", ".join(
        f"{number(noise.drift, 3)} µg over {number(t / 3600, 2)} h" for t in noise.slow_tau_s
    )
    words = {"drift": "drift", "walk": "a random walk, as", "flicker": "flicker noise, as"}
    return f"{text}, and {words[noise.family]} {slow}"
