"""A fitted model with all orders that there are, for readings that may tell of those left out.

What an order left out may do is in the covariance of a fit whose orders the readings chose, and in
the model file (`thermo.uncertainty.unseen_orders`). It is put in full here, with the orders
themselves. Where a user
gave the orders the file says nothing of those above: such an order is taken for one that the rule
of choice would not have taken at a gain of 9 in χ², that is, three sigma.
On the range fitted it is best counted as a Legendre polynomial, which is orthogonal to those in the
model, and whose size the readings tell about as well as that of the highest of them. So it may have
any size within three sigma, found to one: together 2 sigma, √(3²/3 + 1). Without it the fit's
coefficients are off by what this polynomial has in lower powers.

References
----------
Leeb, H. and Pötscher, B. M. (2005), Model selection and inference: facts and fiction, Econometric
Theory 21, 21-59: after a selection the chosen model's own covariance is too small.
Burnham, K. P. and Anderson, D. R. (2002), Model Selection and Multimodel Inference, chapter 4, for
variances that count what the models differ by.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from errormodel.arrays import FloatArray
from errormodel.model import ErrorModel
from thermo.library import MAX_ORDER, term
from thermo.selection.orders import WORTH_CHI2

FAMILIES = ("k0", "k1")
UNSEEN_SIGMAS = float(np.sqrt(WORTH_CHI2 / 3.0 + 1.0))


def with_next_orders(
    model: ErrorModel,
    values: FloatArray,
    cov: FloatArray,
    range_x: tuple[float, float],
    counted: Mapping[tuple[str, int], Mapping[str, float]] | None = None,
) -> tuple[ErrorModel, FloatArray, FloatArray]:
    """Return a fitted model with all higher orders of bias and scale factor, at zero.

    Parameters
    ----------
    model : ErrorModel
    values, cov : ndarray
        In the order of `model.names`, in its own units.
    range_x : pair of float
        Temperatures fitted, less the reference temperature, °C.
    counted : mapping, optional
        Family and order → by how much it moves the coefficients, 1 sigma, for orders that `cov`
        counts; those of coefficients that are not in the model too.

    Returns
    -------
    model, values, cov
        A family that has all orders there are, or is not in the model, is left as it is.
    """
    if not range_x[0] < range_x[1]:
        return model, values, cov
    counted = counted or {}
    own = model.names
    for family in FAMILIES:
        if family in model.names:
            done = [order for name, order in counted if name == family]
            model, values, cov = _extended(model, values, cov, range_x, family, done)
    for moves in counted.values():
        whole = np.array([moves.get(n, 0.0) for n in model.names])
        inside = np.where(np.isin(model.names, own), whole, 0.0)
        cov = cov + np.outer(whole, whole) - np.outer(inside, inside)
    return model, values, cov


def _extended(
    model: ErrorModel, values: FloatArray, cov: FloatArray, range_x: tuple[float, float],
    family: str, counted: Sequence[int],
) -> tuple[ErrorModel, FloatArray, FloatArray]:  # fmt: skip
    orders = [k for k in range(1, MAX_ORDER + 1) if f"{family}_t{k}" in model.names]
    top = max(orders, default=0)
    if top == MAX_ORDER or orders != list(range(1, top + 1)):
        return model, values, cov
    highest = model.names.index(f"{family}_t{top}" if top else family)
    sigma = float(np.sqrt(cov[highest, highest]))
    if family == "k1" and not top:
        sigma /= abs(float(values[highest]))
    size = UNSEEN_SIGMAS * sigma / abs(float(_powers(top, range_x)[top]))
    added = range(top + 1, MAX_ORDER + 1)
    larger = model.with_terms(*(term(f"{family}_t{k}") for k in added))
    by_name = dict(zip(model.names, values.tolist(), strict=True))
    grown = np.array([by_name.get(n, 0.0) for n in larger.names])
    at = [larger.names.index(n) for n in model.names]
    total = np.zeros((grown.size, grown.size))
    total[np.ix_(at, at)] = cov
    for order in (k for k in added if k not in counted):
        unseen = np.zeros(grown.size)
        for k, power in enumerate((size * _powers(order, range_x)).tolist()):
            place = larger.names.index(f"{family}_t{k}" if k else family)
            # the scale factor's polynomial is relative, its constant is not
            unseen[place] = power * (grown[place] if family == "k1" and not k else 1.0)
        total += np.outer(unseen, unseen)
    return larger, grown, total


def _powers(order: int, range_x: Sequence[float]) -> FloatArray:
    """Return the Legendre polynomial of an order on a range, by powers of x."""
    own = Legendre.basis(order, domain=list(range_x))
    return np.asarray(own.convert(kind=Polynomial).coef, dtype=np.float64)
