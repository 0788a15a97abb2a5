"""What polynomial orders that are not in a model may still do to its coefficients.

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

from dataclasses import dataclass
from math import comb

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.columns import Columns
from thermo.library.terms import MAX_ORDER
from thermo.recording.channel import Channel
from thermo.selection.support import settled
from thermo.uncertainty.linearised import Linearised
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
    line: Linearised, channel: Channel, *, chosen: bool, outside: bool
) -> tuple[Unseen, ...]:
    """Return the orders that are not in a model, with what they may do to it.

    Parameters
    ----------
    line : Linearised
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
    held = _Held.of(line, flat)
    above = [
        (order, family)
        for order in range(1, MAX_ORDER + 1)
        for family in FAMILIES
        if order > _top(line, family)
    ]
    found: list[Unseen] = []
    for order, family in above:
        gain = line.fit.value("k1") if family == "k1" else 1.0
        base = held.columns @ (gain * np.eye(len(line.fit.names))[line.fit.names.index(family)])
        left, moves = held.without(
            base * (flat - centre) ** order, _there(line, family, order, centre)
        )
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


def _top(line: Linearised, family: str) -> int:
    """Return the highest order in a model; that of all orders where it has gaps or none at all."""
    orders = [k for k in range(1, MAX_ORDER + 1) if f"{family}_t{k}" in line.fit.names]
    whole = family in line.fit.names and orders == list(range(1, len(orders) + 1))
    return len(orders) if whole else MAX_ORDER


def _usual(line: Linearised, channel: Channel, family: str, order: int) -> float:
    """Return what accelerometers have of an order, 1 sigma, per °C to its power.

    Without K1 in the model, K0 holds the input times K1 too: 1 g where it is not known.
    """
    linear = LINEAR[family]
    if "k1" not in line.fit.names:
        input_g = float(np.abs(line.record["a_i_g"]).max()) if channel.has_input else 1.0
        linear = float(np.hypot(linear, input_g * LINEAR["k1"]))
    return linear * QUARTER ** (order - 1) / SCALE_C**order


def _there(line: Linearised, family: str, order: int, centre: float) -> dict[str, float]:
    """Return (x − centre)^order by the coefficients of the polynomial in x."""
    powers: dict[str, float] = {}
    for k in range(order + 1):
        gain = line.fit.value("k1") if family == "k1" and not k else 1.0
        name = f"{family}_t{k}" if k else family
        powers[name] = gain * comb(order, k) * (-centre) ** (order - k)
    return powers


class _Held:
    """What a fit holds, and by turns the orders above it, each without those before."""

    def __init__(self, line: Linearised, columns: Columns) -> None:
        self.line = line
        self.columns = columns
        triangle = columns.triangle()
        norms = np.linalg.norm(triangle, axis=0)
        norms = np.where(norms > 0, norms, 1.0)
        root = np.linalg.pinv(triangle / norms, rcond=1e-9) / norms[:, None]
        self._inverse = root @ root.T
        self._before: list[tuple[FloatArray, dict[str, float]]] = []

    @classmethod
    def of(cls, line: Linearised, flat: FloatArray) -> "_Held":
        still = line.record.with_signals(x_c=flat)
        return cls(line, Columns(line.fit.model, still, line.fit.as_dict()))

    def without(
        self, effect: FloatArray, there: dict[str, float]
    ) -> tuple[FloatArray, dict[str, float]]:
        """Return what is left of an effect, 0 when nothing, and its moves of the coefficients.

        A move is what the fit takes up less what is there.
        """
        left, moved = effect, np.zeros(self.columns.shape[1])
        # twice is enough for rounding (Parlett, The Symmetric Eigenvalue Problem)
        for _ in range(2):
            more = self._inverse @ self.columns.transposed_times(left)
            left, moved = left - self.columns @ more, moved + more
        moves = dict(zip(self.line.fit.names, moved.tolist(), strict=True))
        for name, own in there.items():
            moves[name] = moves.get(name, 0.0) - own
        for direction, its_moves in self._before:
            share = float(direction @ left) / float(direction @ direction)
            left = left - share * direction
            for name, own in its_moves.items():
                moves[name] = moves.get(name, 0.0) - share * own
        if float(left @ left) <= LEAST_LEFT * float(effect @ effect):
            left = np.zeros_like(left)
        return left, moves

    def known(self, left: FloatArray) -> tuple[float, float]:
        """Return sigma and estimate of an effect by what is left of it; infinite when nothing."""
        length2 = float(left @ left)
        if not length2 > 0:
            return float("inf"), 0.0
        sigma = float(np.sqrt(self.line.variance(left[:, None])[0, 0])) / length2
        return sigma, float(left @ self.line.residual) / length2

    def take(self, left: FloatArray, moves: dict[str, float], sigma: float) -> None:
        """Hold an effect too, where the readings know of it."""
        if np.isfinite(sigma):
            self._before.append((left, moves))
