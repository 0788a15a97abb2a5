"""A covariance analysis told: as the JSON of `accelbench rig covariance`, and in words."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType

from accelbench.shell.console import number, table
from errormodel.arrays import FloatArray
from sinscal.article.tables import ArticleTables, Reading, Table
from sinscal.library import rig_library
from sinscal.planning.advice import Advice
from sinscal.planning.budget import error_budget
from sinscal.planning.covariance import RigCovariance

SIGMA_COLUMNS = ("parameter", "unit", "sigma", "sigma before", "mainly from")
CORRELATED = 0.9
NOT_SEEN = 0.9  # of the prior sigma is left: the programme tells nothing of it
MIN_SHARE = 0.01  # smaller ones are not told in words
HEADINGS = {
    "coarse": "Coarse: without the rig's angle",
    "precise": "Precise: with the rig's angle",
}


def article_document(best: ArticleTables, literal: ArticleTables) -> dict[str, Any]:
    """Return both tables under the reading that fits best, and under the letter."""
    return {
        "programme": "article",
        **_tables(best),
        "reading": _reading(best),
        "literal": {**_tables(literal), **_reading(literal)},
    }


def _tables(made: ArticleTables) -> dict[str, Any]:
    return {"table1": _entries(made.table1), "table2": _entries(made.table2)}


def _entries(one: Table) -> dict[str, Any]:
    return {
        key: {"published": e.published, "computed": e.computed, "ratio": e.ratio}
        for key, e in one.items()
    }


def _reading(made: ArticleTables) -> dict[str, Any]:
    r: Reading = made.reading
    return {
        "assumed": list(r.words),
        "accel_factor": r.accel_factor,
        "gyro_factor": r.gyro_factor,
        "carried": r.carried,
        "azimuth_arcmin": r.azimuth_arcmin,
        "base": r.base,
        "remounted": r.remounted,
        "rms_log_ratio": made.rms_log,
    }


def analysis_document(
    found: Mapping[str, RigCovariance], advice: Mapping[str, Sequence[Advice]]
) -> dict[str, Any]:
    """Return each mode's result under its name; with one mode also its names and covariance."""
    document: dict[str, Any] = {
        mode: {**_mode(one), "advice": [_advised(a) for a in advice.get(mode, ())]}
        for mode, one in found.items()
    }
    if len(found) == 1:
        (one,) = document.values()
        document |= {"names": one["names"], "covariance": one["covariance"]}
    return document


def _mode(one: RigCovariance) -> dict[str, Any]:
    units = units_of(one)
    variance = np.diag(one.cov)
    return {
        "names": list(one.names),
        "covariance": one.cov.tolist(),
        "parameters": {
            name: {"sigma": float(s), "prior_sigma": float(p), "unit": units[name]}
            for name, s, p in zip(one.names, one.sigmas, one.prior_sigmas, strict=True)
        },
        "error_budget": {
            source: dict(zip(one.names, _share(part, variance).tolist(), strict=True))
            for source, part in error_budget(one).items()
        },
        "correlated": [{"names": [a, b], "correlation": value} for a, b, value in correlated(one)],
        "not_seen": list(not_seen(one)),
    }


def _advised(one: Advice) -> dict[str, Any]:
    return {
        "change": one.change,
        "parameter": one.name,
        "sigma_before": one.before,
        "sigma_after": one.after,
        "factor": one.factor,
        "other_groups": list(one.others),
    }


def _share(part: FloatArray, variance: FloatArray) -> FloatArray:
    return np.divide(part, variance, out=np.zeros_like(part), where=variance > 0.0)


def units_of(one: RigCovariance) -> dict[str, str]:
    """Return the unit of every parameter."""
    return {name: one.units.get(name, "rad") for name in one.names}


def correlations(one: RigCovariance) -> FloatArray:
    """Return the matrix of correlations, shape (p, p)."""
    sigma = one.sigmas
    return one.cov / np.outer(sigma, sigma)


def correlated(one: RigCovariance) -> list[tuple[str, str, float]]:
    """Return the pairs whose correlation exceeds `CORRELATED`."""
    matrix = correlations(one)
    rows, columns = np.nonzero(np.abs(np.triu(matrix, 1)) > CORRELATED)
    return [
        (one.names[i], one.names[j], float(matrix[i, j]))
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True)
    ]


def not_seen(one: RigCovariance) -> Iterator[str]:
    """Return the parameters whose sigma the programme hardly reduces."""
    for name, sigma, prior in zip(one.names, one.sigmas, one.prior_sigmas, strict=True):
        if sigma > NOT_SEEN * prior:
            yield name


def groups_in(one: RigCovariance) -> dict[str, list[int]]:
    """Return the places of each group of parameters."""
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(one.names):
        groups.setdefault(rig_library().parameter(name).family, []).append(k)
    return groups


def main_sources(one: RigCovariance) -> dict[str, FloatArray]:
    """Return each source's share of the variance of each group, mean over it, (groups,)."""
    groups, variance = groups_in(one), np.diag(one.cov)
    out: dict[str, FloatArray] = {}
    for source, part in error_budget(one).items():
        share = _share(part, variance)
        out[source] = np.array([np.mean(share[places]) for places in groups.values()])
    return out


def article_text(best: ArticleTables, literal: ArticleTables) -> Iterator[RenderableType]:
    """Tell both tables under both readings."""
    for title, rows in article_rows(best, literal):
        yield title
        names = ("published", "computed", "ratio", "to the letter", "its ratio")
        made = table("entry", *names, right=names)
        for row in rows:
            made.add_row(*row)
        yield made
    yield from assumed(best, literal)
    yield ""


def article_rows(
    best: ArticleTables, literal: ArticleTables
) -> Iterator[tuple[str, list[tuple[str, ...]]]]:
    """Return the title and the rows of each of the article's tables."""
    titles = ("Table 1, without the rig's angle", "Table 2, with the rig's angle")
    pairs = ((best.table1, literal.table1), (best.table2, literal.table2))
    for title, (one, letter) in zip(titles, pairs, strict=True):
        rows: list[tuple[str, ...]] = []
        for key, e in one.items():
            other = letter[key]
            computed = (number(e.published, 3), number(e.computed, 3), f"{e.ratio:.2f}")
            rows.append((key, *computed, number(other.computed, 3), f"{other.ratio:.2f}"))
        yield title, rows


def assumed(best: ArticleTables, literal: ArticleTables) -> Iterator[str]:
    """Say what was assumed, and how well it fits."""
    for what, made in (
        ("Computed under the interpretation that fits best", best),
        ("To the letter", literal),
    ):
        size = np.exp(made.rms_log)
        yield f"{what} (ratios off by a factor of {size:.3g} rms): {' '.join(made.reading.words)}"


def analysis_text(
    found: Mapping[str, RigCovariance], advice: Mapping[str, Sequence[Advice]]
) -> Iterator[RenderableType]:
    """Tell each mode's sigmas."""
    for mode, one in found.items():
        yield HEADINGS[mode]
        made = table(*SIGMA_COLUMNS, right=SIGMA_COLUMNS[2:4], words=SIGMA_COLUMNS[4:], keys=2)
        for row in sigma_rows(one):
            made.add_row(*row)
        yield made
        yield from remarks(one, advice.get(mode, ()))
        yield ""


def sigma_rows(one: RigCovariance) -> Iterator[tuple[str, ...]]:
    """Return a row for every parameter, in the unit people are told it in: `SIGMA_COLUMNS`."""
    variance, budget = np.diag(one.cov), error_budget(one)
    for k, name in enumerate(one.names):
        shares = {s: float(_share(part, variance)[k]) for s, part in budget.items()}
        main = sorted(shares, key=lambda s: -shares[s])[:2]
        told = ", ".join(f"{s} {100 * shares[s]:.0f} %" for s in main if shares[s] > MIN_SHARE)
        unit, size = told_in(name)
        sigma, prior = float(one.sigmas[k]) / size, float(one.prior_sigmas[k]) / size
        yield name, unit, number(sigma, 2), number(prior, 2), told


def told_in(name: str) -> tuple[str, float]:
    """Return the unit in which people are told a parameter, and how many SI units that is."""
    told = rig_library().parameter(name).told_in
    return told.unit, told.size


def remarks(one: RigCovariance, advice: Sequence[Advice]) -> Iterator[str]:
    """Say what would make the programme better, what it does not show and does not tell apart."""
    for a in advice:
        unit, size = told_in(a.name)
        more = f"; {', '.join(a.others)} gain as well" if a.others else ""
        yield (
            f"With {a.change} {a.name} would be {number(a.factor, 2)} times better, "
            f"{number(a.after / size, 2)} instead of {number(a.before / size, 2)} {unit}{more}."
        )
    if unseen := list(not_seen(one)):
        yield f"Hardly seen (more than 90 % of the prior sigma is left): {', '.join(unseen)}."
    for a, b, value in correlated(one):
        yield f"Hardly separable: {a} and {b} (correlation {number(value, 3)})."
