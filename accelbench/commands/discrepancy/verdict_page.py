"""The page of a verdict, of a chamber's runs or of a rig's: one that a metrologist would sign."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from accelbench.shell.console import number
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import Banner, BannerState, Page, ReportTable, Section, render_page
from accelbench.shell.plotting import Picture
from errormodel.discrepancy.investigation import Conclusion

KEEP = "Keep the present model."
ENLARGE = "Fit again with the effect in the model; the sizes are below."
RECORD = "Keep the present model for now; the finding below says what run would decide."
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
    title: str,
    runs: Sequence[str],
    pages: Sequence[VerdictPage],
    conventions: Sequence[str],
    measured: str = "",
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
    measured : str
        When; empty if that is not recorded.
    """
    page = Page(
        title=title,
        about=f"runs {', '.join(runs)}",
        measured=measured,
        verdicts=tuple(_banner(p) for p in pages),
        sections=(
            *(section for one in pages for section in _sections(one)),
            Section(title="How to read it", points=(*CONVENTIONS, *conventions)),
        ),
    )
    return render_page(page, REPORT_NAME)


def _banner(one: VerdictPage) -> Banner:
    state: BannerState = "good" if one.verdict == "nothing is missing" else "open"
    named = ", ".join(dict.fromkeys(name for name, *_ in one.effects))
    text = f"{one.name}: {one.verdict}" + (f": {named}" if named else "")
    todo = KEEP if state == "good" else ENLARGE if named else RECORD
    return Banner(text=text, state=state, todo=todo)


def _sections(one: VerdictPage) -> Iterator[Section]:
    """Yield the parts of a verdict: the finding, its pictures, and its rivals."""
    effects = ReportTable(columns=("effect", "parameter", "value", "unit"), rows=one.effects)
    yield Section(
        title=f"{one.name}: {one.verdict}",
        points=one.lines,
        table=effects if one.effects else None,
        words=(0, 1, 3),
        pictures=one.pictures,
    )
    title = "What else it could have been" if one.effects else "What these runs would have shown"
    columns = (
        "effect",
        "explains less by (2 ln L)",
        "judged",
        "smallest that these runs would name",
    )
    yield Section(
        title=title,
        level=3,
        table=ReportTable(columns=columns, rows=one.rivals),
        words=(0, 2, 3),
        after=(f"Noise: {one.noise}.",),
    )
