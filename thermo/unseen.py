"""What polynomial orders that the readings do not show may do, where nothing holds them.

A polynomial of chosen order is right where there are readings: a higher order that was there would
have shown. Between two soaks, or outside the range, it would not. There an order may be as large as
accelerometers have it, or as the readings allow, whichever is less, and the covariance counts it.
"""

from dataclasses import dataclass
from math import comb

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.columns import Columns
from thermo.inputs import Channel
from thermo.linearised import Linearised
from thermo.next_order import FAMILIES, UNSEEN_SIGMAS
from thermo.support import settled
from thermo.terms import MAX_ORDER

# What polynomials of quartz-flexure accelerometers are like, 1 sigma: 20 µg/°C and 150 ppm/°C, and
# over 50 °C each order a quarter of the one below it.
SCALE_C = 50.0
QUARTER = 0.25
# Where the readings allow ten times what accelerometers have, they say nothing of the order. Where
# they do say something, the choice of orders has heard it.
UNLIMITED = 0.1
LINEAR = {"k0": 20e-6 * SCALE_C, "k1": 150e-6 * SCALE_C}


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


def unseen_orders(line: Linearised, channel: Channel, *, outside: bool) -> tuple[Unseen, ...]:
    """Return the orders that the readings cannot limit, or all that are left when `outside`.

    Parameters
    ----------
    line : Linearised
    channel : Channel
        What was fitted.
    outside : bool
        Whether the reference temperature lies outside the readings.
    """
    flat = settled(channel)
    still = line.record.with_signals(x_c=flat)
    columns = Columns(line.fit.model, still, line.fit.as_dict())
    centre = 0.5 * float(flat.min() + flat.max())
    found: list[Unseen] = []
    for family in FAMILIES:
        names = line.fit.names
        orders = [k for k in range(1, MAX_ORDER + 1) if f"{family}_t{k}" in names]
        if family not in names or orders != list(range(1, len(orders) + 1)):
            continue
        gain = line.fit.value("k1") if family == "k1" else 1.0
        base = columns @ (gain * np.eye(len(names))[names.index(family)])
        for order in range(len(orders) + 1, MAX_ORDER + 1):
            usual = LINEAR[family] * QUARTER ** (order - 1) / SCALE_C**order
            effect = base * (flat - centre) ** order
            absorbed = _absorbed(columns, effect)
            limit = UNSEEN_SIGMAS * _sigma(line, effect, columns @ absorbed)
            if outside or usual < UNLIMITED * limit:
                size = min(usual, limit)
                found.append(_unseen(line, family, order, centre, size, absorbed * size))
    return tuple(found)


def _absorbed(columns: Columns, effect: FloatArray) -> FloatArray:
    """Return the coefficients that take up an effect: rotations keep every length and angle."""
    triangle = columns.triangle(effect[:, None])
    norms = np.linalg.norm(triangle[:, :-1], axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    scaled = np.asarray(triangle[:, :-1] / norms, dtype=np.float64)
    return np.asarray(np.linalg.lstsq(scaled, triangle[:, -1], rcond=1e-9)[0] / norms)


def _sigma(line: Linearised, effect: FloatArray, taken: FloatArray) -> float:
    """Return how well the readings would give the effect's size, infinite when not at all."""
    left = effect - taken
    length2 = float(left @ left)
    if length2 <= 1e-10 * float(effect @ effect):
        return float("inf")
    return float(np.sqrt(line.variance(left[:, None])[0, 0]) / length2)


def _unseen(
    line: Linearised, family: str, order: int, centre: float, size: float, moved: FloatArray
) -> Unseen:
    """Return the error of the coefficients: what the fit takes up less what is there."""
    moves = dict(zip(line.fit.names, moved.tolist(), strict=True))
    for k in range(order + 1):
        name = f"{family}_t{k}" if k else family
        there = size * comb(order, k) * (-centre) ** (order - k)
        if family == "k1" and not k:
            there *= line.fit.value("k1")
        moves[name] = moves.get(name, 0.0) - there
    return Unseen(family=family, order=order, moves=moves)
