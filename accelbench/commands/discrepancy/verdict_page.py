"""The page of a verdict, of a chamber's runs or of a rig's: one that a metrologist would sign."""

from collections.abc import Sequence
from dataclasses import dataclass

from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import embedded, rendered
from accelbench.shell.plotting import Picture

CONVENTIONS = (
    "Strength is the whitened size of an effect beside everything else in the model: how many of "
    "its own sigmas it has. From seven on it can be named.",
    "p is the probability that noise alone gives as much to any effect of the library; its null "
    "comes from simulated runs.",
    "Effects within nine of the best in twice the log-likelihood cannot be told apart.",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictPage:
    """One verdict.

    Attributes
    ----------
    name : str
        Of the accelerometer or the run.
    verdict : str
    lines : tuple of str
        What was found, in sentences.
    effects : tuple of (effect, parameter, value, unit)
    pictures : tuple of Picture
    rivals : tuple of (effect, how much less it explains, how it was judged, smallest nameable)
    noise : str
    """

    name: str
    verdict: str
    lines: tuple[str, ...]
    effects: tuple[tuple[str, str, str, str], ...]
    pictures: tuple[Picture, ...]
    rivals: tuple[tuple[str, str, str, str], ...]
    noise: str

    @property
    def figures(self) -> list[dict[str, str]]:
        """The pictures as the template takes them."""
        return [embedded(p) for p in self.pictures]


def render_verdicts(
    title: str, runs: Sequence[str], pages: Sequence[VerdictPage], conventions: Sequence[str]
) -> dict[str, bytes]:
    """Return a report's files by name, without writing any.

    Parameters
    ----------
    title : str
    runs : sequence of str
        What the verdicts were found in.
    pages : sequence of VerdictPage
    conventions : sequence of str
        How to read it, beside what is common to all.
    """
    html = rendered(
        "discrepancy.html.j2",
        title=title,
        runs=list(runs),
        pages=pages,
        conventions=(*CONVENTIONS, *conventions),
    )
    return {REPORT_NAME: html.encode(), **{p.name: p.png for one in pages for p in one.pictures}}
