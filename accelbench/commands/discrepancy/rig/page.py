"""The report of a verdict on a rig run: one page, and its figures."""

from collections.abc import Mapping
from pathlib import Path

from accelbench.commands.discrepancy.rig.figures import draw_cycles, draw_innovations_by_factor
from accelbench.commands.discrepancy.rig.text import rig_lines, told_noise, told_parameters
from accelbench.commands.discrepancy.text import VERDICT_WORDS
from accelbench.commands.discrepancy.verdict_page import VerdictPage, render_verdicts, rival_rows
from accelbench.shell.console import number
from sinscal.discrepancy.find import RigDiscrepancy
from sinscal.library import rig_library
from sinscal.recording.run import RigRun

CONVENTIONS = (
    "An innovation is the difference between a measurement and its prediction by the filter. "
    "Divided by their sigmas, innovations are white if no effect is missing. The signature of an "
    "effect is computed by passing it through the filter's gains. A named effect is added to the "
    "filter, and the filter is run again.",
    "The rows rig_axis_1 and rig_axis_2 are across the rig's axis: their sigma is a bound, and "
    "the second to fourth harmonics of the rotation in them are due to the bearing.",
    "Held out: effects are selected again without the cycle, and their sizes are taken from the "
    "other cycles; a size that the other cycles do not determine stays zero. Noise alone is the "
    "residual expected from the measured noise.",
)


def render_rig_discrepancy(d: RigDiscrepancy, run: RigRun) -> dict[str, bytes]:
    """Return a report's files by name, without writing any.

    Parameters
    ----------
    d : RigDiscrepancy
    run : RigRun
        Run that it was found in.

    Returns
    -------
    dict of str to bytes
    """
    name = Path(run.source).name
    page = VerdictPage(
        name=f"{name}, {d.source.mode}",
        verdict=VERDICT_WORDS[d.verdict],
        lines=tuple(rig_lines(d)),
        effects=tuple(told_parameters(d)),
        pictures=(draw_innovations_by_factor(d), draw_cycles(d)),
        rivals=tuple(rival_rows(d, d.source.effects, _smallest(d), d.source.holds)),
        noise=_noise(d),
    )
    cycles = [f"{name}, {len(run.cycles)} cycles"]
    return render_verdicts("What is missing from the model of a SINS", cycles, [page], CONVENTIONS)


def _smallest(d: RigDiscrepancy) -> Mapping[str, str]:
    """Return the smallest size of each effect that can be named, in the unit it is reported in."""
    made: dict[str, str] = {}
    for effect in d.source.effects:
        if effect.name in d.smallest_nameable:
            value, _ = d.smallest_nameable[effect.name]
            told = rig_library().told[(*effect.groups, effect.name)[0]].told_in
            made[effect.name] = f"{number(value / told.size, 2)} {told.unit}"
    return made


def _noise(d: RigDiscrepancy) -> str:
    return f"measured in this run: {'; '.join(told_noise(n) for n in d.noise)}"
