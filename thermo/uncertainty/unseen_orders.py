"""Effect of polynomial orders that are not in a model on its coefficients.

Readings choose the orders, and an order left out need not be zero: it may lie within its noise,
and it moves its neighbours by many of their sigmas. So every order above the chosen ones is
*considered* (see `thermo.uncertainty.considered`) with the mean square that the readings leave to
it.

With s the sigma of the order's coefficient in the fit enlarged by it, and t its estimate there over
s, it is there with the odds k·exp(t²/2): even odds beforehand, and a size that is known to three
decades only. Over these, log uniform, the mean likelihood against none is exp(t²/2)·√(π/2)/(t·ln
1000), about 0.2·exp(t²/2) where it decides, at t of 1 to 2. If it is there, its mean square is
(1 + t²)·s². Where the readings say nothing (s without limit) it is what accelerometers have, and
nowhere more: so it is between two soaks, and outside the range.

References
----------
Hoeting, J. A. et al. (1999), Bayesian model averaging: a tutorial, Statistical Science 14, 382-417.
Burnham, K. P. and Anderson, D. R. (2002), Model Selection and Multimodel Inference, chapter 4.
Leeb, H. and Pötscher, B. M. (2005), Model selection and inference: facts and fiction, Econometric
Theory 21, 21-59: after a selection the chosen model's own covariance is too small.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.columns import Columns
from errormodel.linear import triangle_of
from thermo.library import MAX_ORDER
from thermo.recording.channel import Channel
from thermo.selection.support import settled
from thermo.uncertainty.linearised import LinearisedFit
from thermo.uncertainty.order_choice import FAMILIES

# What polynomials of quartz-flexure accelerometers are like, 1 sigma: 20 µg/°C and 150 ppm/°C, and
# over 50 °C each order a quarter of the one below it.
SCALE_C = 50.0
QUARTER = 0.25
LINEAR = {"k0": 20e-6 * SCALE_C, "k1": 150e-6 * SCALE_C}
EVIDENCE = 0.2  # k above
# Where its sigma is five times what accelerometers have, the readings say nothing of an order.
UNLIMITED = 0.2
LEAST_LEFT = 1e-10  # of an effect's square that the model does not hold; less is rounding


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Unseen:
    """One order that is not in a model: how far it may put the coefficients wrong, 1 sigma.

    Attributes
    ----------
    family : str
        "k0" or "k1".
    order : int
    moves : dict of str to float
        By coefficient, in the model's unit; those that are not in the model too.
    """

    family: str
    order: int
    moves: dict[str, float]

    def among(self, names: tuple[str, ...]) -> FloatArray:
        """Return the moves of some coefficients, 0 for those without."""
        return np.array([self.moves.get(n, 0.0) for n in names])


def unseen_orders(
    line: LinearisedFit, channel: Channel, *, chosen: bool, outside: bool
) -> tuple[Unseen, ...]:
    """Return the orders that are not in a model, with what they may do to it.

    Parameters
    ----------
    line : LinearisedFit
    channel : Channel
        What was fitted.
    chosen : bool
        Whether the readings chose the orders. The user's are taken for the true ones; of those
        above them only what the readings cannot limit counts.
    outside : bool
        Whether the reference temperature lies outside the readings: all orders count then.
    """
    flat = settled(channel)
    centre = 0.5 * float(flat.min() + flat.max())
    above = [
        (order, family)
        for order in range(1, MAX_ORDER + 1)
        for family in FAMILIES
        if order > _top(line, family)
    ]
    held = _Held(line, flat, centre, above)
    found: list[Unseen] = []
    for k, (order, family) in enumerate(above):
        left, moves = held.without(k, _there(line, family, order, centre))
        sigma, amount = held.known(left)
        usual = _usual(line, channel, family, order)
        if chosen or outside or usual < UNLIMITED * sigma:
            held.take(left, moves, sigma)
            size = min(usual, root_mean_square(amount, sigma))
            found.append(
                Unseen(
                    family=family,
                    order=order,
                    moves={n: size * m for n, m in moves.items()},
                )
            )
    return tuple(found)


def root_mean_square(amount: float, sigma: float) -> float:
    """Return the rms that readings leave to an order that was estimated and then left out."""
    if not np.isfinite(sigma):
        return sigma
    square = (amount / sigma) ** 2
    there = 1.0 / (1.0 + np.exp(min(-0.5 * square, 0.0)) / EVIDENCE)
    return sigma * float(np.sqrt(there * (1.0 + square)))


def _top(line: LinearisedFit, family: str) -> int:
    """Return the highest order in a model; that of all orders where it has gaps or none at all."""
    orders = [k for k in range(1, MAX_ORDER + 1) if f"{family}_t{k}" in line.fit.names]
    whole = family in line.fit.names and orders == list(range(1, len(orders) + 1))
    return len(orders) if whole else MAX_ORDER


def _usual(line: LinearisedFit, channel: Channel, family: str, order: int) -> float:
    """Return what accelerometers have of an order, 1 sigma, per °C to its power.

    Without K1 in the model, K0 holds the input times K1 too: 1 g where it is not known.
    """
    linear = LINEAR[family]
    if "k1" not in line.fit.names:
        input_g = float(np.abs(line.record["a_i_g"]).max()) if channel.has_input else 1.0
        linear = float(np.hypot(linear, input_g * LINEAR["k1"]))
    return linear * QUARTER ** (order - 1) / SCALE_C**order


def _there(line: LinearisedFit, family: str, order: int, centre: float) -> dict[str, float]:
    """Return (x − centre)^order by the coefficients of the polynomial in x."""
    powers: dict[str, float] = {}
    for k in range(order + 1):
        gain = line.fit.value("k1") if family == "k1" and not k else 1.0
        name = f"{family}_t{k}" if k else family
        powers[name] = gain * comb(order, k) * (-centre) ** (order - k)
    return powers


class _Held:
    """Regressors of a fit, and by turns the orders above it, each without those before.

    All are sums of the fit's columns, soaks at one temperature, and of the orders' effects: of
    these only the triangle is kept, and what is left of an effect as its factors.
    """

    def __init__(
        self, line: LinearisedFit, flat: FloatArray, centre: float, above: list[tuple[int, str]]
    ) -> None:
        self.line, self._flat, self._centre, self._above = line, flat, centre, above
        still = line.record.with_signals(x_c=flat)
        self._columns = Columns(line.fit.model, still, line.fit.as_dict())
        triangle: FloatArray | None = None
        for _, block in self._blocks():
            triangle = triangle_of(block, triangle)
        assert triangle is not None  # a fit has readings
        self._basis = triangle  # columns and effects in the axes that the rotation found
        held = triangle[:, : self._columns.shape[1]]
        norms = np.linalg.norm(held, axis=0)
        norms = np.where(norms > 0, norms, 1.0)
        root = np.linalg.pinv(held / norms, rcond=1e-9) / norms[:, None]
        self._held, self._inverse = held, root @ root.T
        self._before: list[tuple[FloatArray, dict[str, float]]] = []

    def _blocks(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the readings of each block with the fit's columns and the orders' effects."""
        fit = self.line.fit
        for rows, block in self._columns.blocks():
            x = self._flat[rows] - self._centre
            effects = [
                (fit.value("k1") if family == "k1" else 1.0)
                * block[:, fit.names.index(family)]
                * x**order
                for order, family in self._above
            ]
            yield rows, np.column_stack([block, *effects])

    def without(self, k: int, there: dict[str, float]) -> tuple[FloatArray, dict[str, float]]:
        """Return what is left of the k-th effect and its moves of the coefficients.

        What is left is given as factors of the columns and effects, 0 when nothing. A move is
        what the fit takes up less what is there.
        """
        p = self._columns.shape[1]
        factors = np.zeros(self._basis.shape[1])
        factors[p + k] = 1.0
        effect = left = self._basis[:, p + k]
        moved = np.zeros(p)
        # twice is enough for rounding (Parlett, The Symmetric Eigenvalue Problem)
        for _ in range(2):
            more = self._inverse @ (self._held.T @ left)
            left, moved = left - self._held @ more, moved + more
        factors[:p] -= moved
        moves = dict(zip(self.line.fit.names, moved.tolist(), strict=True))
        for name, own in there.items():
            moves[name] = moves.get(name, 0.0) - own
        for before, its_moves in self._before:
            direction = self._basis @ before
            share = float(direction @ left) / float(direction @ direction)
            left = left - share * direction
            factors -= share * before
            for name, own in its_moves.items():
                moves[name] = moves.get(name, 0.0) - share * own
        if float(left @ left) <= LEAST_LEFT * float(effect @ effect):
            factors = np.zeros_like(factors)
        return factors, moves

    def known(self, left: FloatArray) -> tuple[float, float]:
        """Return sigma and estimate of an effect by what is left of it; infinite when nothing."""
        if not np.any(left):
            return float("inf"), 0.0
        sums = self.line.sums((rows, block @ left[:, None]) for rows, block in self._blocks())
        length2 = float(sums.gram[0, 0])
        return float(np.sqrt(sums.cov[0, 0])) / length2, float(sums.along[0]) / length2

    def take(self, left: FloatArray, moves: dict[str, float], sigma: float) -> None:
        """Hold an effect too, where the readings know of it."""
        if np.isfinite(sigma):
            self._before.append((left, moves))
