"""The report of a verdict: one page a metrologist would sign, and its figures."""

from collections.abc import Iterator, Sequence

from accelbench.commands.discrepancy.figures import draw_factor, draw_gap
from accelbench.commands.discrepancy.text import VERDICT_WORDS, shared_lines, verdict_lines
from accelbench.commands.discrepancy.verdict_page import VerdictPage, render_verdicts
from accelbench.commands.fit.text import value_and_sigma
from accelbench.shell.console import number
from thermo.discrepancy.find import Discrepancy
from thermo.discrepancy.smallest import smallest_nameable
from thermo.recording.files import RecordedRuns

CONVENTIONS = (
    "In each simulated run the noise is estimated anew.",
    "Held out: each run is predicted from the others, the choice of effect repeated without it.",
    "Noise alone is what a run that was not fitted would leave if nothing were missing.",
)


def render_discrepancy(found: Sequence[Discrepancy], runs: RecordedRuns) -> dict[str, bytes]:
    """Return a report's files by name, without writing any.

    Parameters
    ----------
    found : sequence of Discrepancy
    runs : RecordedRuns
        What they were found in.

    Returns
    -------
    dict of str to bytes
    """
    title = f"What is missing from the model of {', '.join(d.serial for d in found):.80}"
    return render_verdicts(title, runs.run_ids, [_page(d) for d in found], CONVENTIONS)


def _page(d: Discrepancy) -> VerdictPage:
    return VerdictPage(
        name=d.serial,
        verdict=VERDICT_WORDS[d.verdict],
        lines=(*verdict_lines(d), *shared_lines([d])),
        effects=tuple(
            (e.name, name, value_and_sigma(p.value, p.sigma), p.unit)
            for e in d.effects
            for name, p in e.parameters.items()
        ),
        pictures=(draw_factor(d), draw_gap(d)),
        rivals=tuple(_rivals(d)),
        noise=_noise(d),
    )


def _rivals(d: Discrepancy) -> Iterator[tuple[str, str, str, str]]:
    """Yield every effect of the library with how it was judged."""
    smallest = smallest_nameable(d)
    below = dict(d.result.slots[0].rivals) if d.effects else {}
    alias = {n for s in d.alias_sets for n in s}
    named = {e.name for e in d.effects}
    for effect in d.source.effects:
        name = effect.name
        least = smallest.get(name)
        size = f"{number(least.value, 2)} {least.unit}" if least else "–"
        if name in named:
            judged = "named"
        elif name in alias:
            judged = "cannot be told from the one named"
        elif name in d.invisible:
            judged = "cannot be seen in these runs"
        elif d.source.holds_some(effect):
            judged = "in the present model"
        else:
            judged = "excluded" if d.effects else "not called for"
        yield name, number(below.get(name), 3), judged, size


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
