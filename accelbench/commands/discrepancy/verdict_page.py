"""The page of a verdict, of a chamber's runs or of a rig's: one that a metrologist would sign."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from accelbench.shell.console import number
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import embedded, rendered
from accelbench.shell.plotting import Picture
from errormodel.discrepancy.investigation import Conclusion

CONVENTIONS = (
    "Strength is the whitened size of an effect beside everything else in the model, in units of "
    "its own sigma. An effect of strength seven or more can be named.",
    "p is the probability that noise alone gives an equally significant effect of the library; "
    "its distribution comes from simulated runs.",
    "Effects within nine of the best in twice the log-likelihood cannot be separated.",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictPage:
    """One verdict.

    Attributes
    ----------
    name : str
        Accelerometer or run.
    verdict : str
    lines : tuple of str
        The finding in sentences.
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


class Named(Protocol):
    """An effect of either library."""

    @property
    def name(self) -> str:
        """Name of the effect."""
        ...


Effect = TypeVar("Effect", bound=Named)


def rival_rows(
    d: Conclusion[Any, Any],
    effects: Sequence[Effect],
    smallest: Mapping[str, str],
    held: Callable[[Effect], bool],
) -> Iterator[tuple[str, str, str, str]]:
    """Yield every effect of the library with how it was judged.

    Parameters
    ----------
    d : Conclusion
    effects : sequence
        The library.
    smallest : mapping of str to str
        The smallest size of an effect that can be named, with its unit.
    held : callable
        Tells whether the present model has an effect already.
    """
    named = {c.name for c in d.choices}
    below = dict(d.result.slots[0].rivals) if named else {}
    alias = {n for s in d.alias_sets for n in s}
    for effect in effects:
        name = effect.name
        if name in named:
            verdict = "named"
        elif name in alias:
            verdict = "cannot be separated from the named one"
        elif held(effect):
            verdict = "in the present model"
        elif name in d.invisible:
            verdict = "cannot be seen in these data"
        else:
            verdict = "excluded" if named else "not called for"
        yield name, number(below.get(name), 3), verdict, smallest.get(name, "–")


def render_verdicts(
    title: str, runs: Sequence[str], pages: Sequence[VerdictPage], conventions: Sequence[str]
) -> dict[str, bytes]:
    """Return a report's files by name, without writing any.

    Parameters
    ----------
    title : str
    runs : sequence of str
        Runs that the verdicts were found in.
    pages : sequence of VerdictPage
    conventions : sequence of str
        Notes on reading it, beside those common to all.
    """
    html = rendered(
        "discrepancy.html.j2",
        title=title,
        runs=list(runs),
        pages=pages,
        conventions=(*CONVENTIONS, *conventions),
    )
    return {REPORT_NAME: html.encode(), **{p.name: p.png for one in pages for p in one.pictures}}
