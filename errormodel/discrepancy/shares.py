"""Shares of the excess that each name explains, and the rest."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from errormodel.discrepancy.investigation import Conclusion


@dataclass(frozen=True, slots=True, kw_only=True)
class Shares:
    """The excess and how it is shared out.

    Attributes
    ----------
    excess : float
        Chi-square above what noise gives: what the names explain, and the rest.
    names : mapping of str to float
        Share of each name beside the others. Names that explain the same have a part in common,
        which counts for none of them: they add up to less than all names together.
    rest : str or None
        Factor that the rest follows; None where no rest is significant.
    rest_share : float
    """

    excess: float
    names: Mapping[str, float]
    rest: str | None
    rest_share: float


def shares_of(found: Conclusion[Any, Any], shape: tuple[str, float] | None = None) -> Shares:
    """Return the shares of the excess.

    Parameters
    ----------
    found : Conclusion
    shape : tuple of (str, float), optional
        Quantity of a shape built for the rest, and the chi-square that it explains; by default the
        rest is what the factor that carries most of it does.
    """
    result, judgement = found.result, found.judgement
    rest, left = shape or (None, 0.0)
    if shape is None and judgement.verdict != "nothing":
        passing = judgement.verdict == "unexplained_noise"
        for one in judgement.rest:
            open_still = one.p_value < result.rules.alpha_rest
            if open_still and (one.repeatable or passing) and one.excess > left:
                rest, left = one.name, one.excess
    total = result.explained + left
    return Shares(
        excess=total,
        names={s.choice.name: s.gain / total for s in result.slots} if total > 0.0 else {},
        rest=rest,
        rest_share=left / total if total > 0.0 else 0.0,
    )
