"""Which terms a set of runs can carry: what is separable, and what order held-out runs want."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.compressed import compress, solve_compressed
from errormodel.errors import InputError
from errormodel.fit import examine
from errormodel.model import ErrorModel
from thermo.inputs import Channel
from thermo.terms import MAX_ORDER, STATIC_NAMES, term

# An order is worth its coefficient when it lowers the held-out rms by this share or more.
WORTH = 0.01
# With one run only, it is left out in this many pieces, one after another.
PIECES = 10
# Enough readings to judge separability; more only repeat the same geometry.
EXAMINED = 4000


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderTrial:
    """How one pair of polynomial orders does on readings it was not fitted to."""

    k0_order: int
    k1_order: int
    residual_ug: float
    heldout_ug: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """The model chosen, and what it was chosen from.

    Attributes
    ----------
    model : ErrorModel
    k0_order, k1_order : int
    trials : tuple of OrderTrial
        Every pair of orders that the data can separate.
    not_separable : tuple of str
        Coefficients of the model equation that these data cannot give.
    held_out : str
        What was held out, in words.
    """

    model: ErrorModel
    k0_order: int
    k1_order: int
    trials: tuple[OrderTrial, ...]
    not_separable: tuple[str, ...]
    held_out: str

    def trial(self, k0_order: int, k1_order: int) -> OrderTrial | None:
        """Return one trial, None when that pair was not separable."""
        for t in self.trials:
            if (t.k0_order, t.k1_order) == (k0_order, k1_order):
                return t
        return None


def select_model(channel: Channel) -> Selection:
    """Choose the terms of the model equation for one accelerometer's runs.

    Every position-dependent coefficient that the data can separate is taken. The orders of the
    bias's and the scale factor's polynomials are those of the lowest rms on held-out runs, each
    run predicted from the others; the simplest pair within 1 % of it wins. A single run is held
    out piece by piece instead.

    Raises
    ------
    InputError
        If there are too few readings.
    """
    if len(channel.record) < 30:
        raise InputError(
            f"serial {channel.serial}",
            "",
            f"{len(channel.record)} readings; a fit needs 30 at least",
        )
    names, lost = separable_names(channel)
    static = [n for n in names if n in STATIC_NAMES or n in ("k0", "k1")]
    top0 = max(k for k in range(MAX_ORDER + 1) if k == 0 or f"k0_t{k}" in names)
    top1 = max(k for k in range(MAX_ORDER + 1) if k == 0 or f"k1_t{k}" in names)
    pieces, held_out = _pieces(channel)
    folded = _Folded(channel, static, top0, top1, pieces)
    trials = tuple(folded.trial(i, j) for i in range(top0 + 1) for j in range(top1 + 1))
    best = min(t.heldout_ug for t in trials)
    good = [t for t in trials if t.heldout_ug <= best * (1.0 + WORTH)]
    chosen = min(good, key=lambda t: (t.k0_order + t.k1_order, t.heldout_ug))
    return Selection(
        model=equation(static, chosen.k0_order, chosen.k1_order),
        k0_order=chosen.k0_order,
        k1_order=chosen.k1_order,
        trials=trials,
        not_separable=lost,
        held_out=held_out,
    )


def equation(static: Sequence[str], k0_order: int, k1_order: int) -> ErrorModel:
    """Return the model equation with the terms and polynomial orders given."""
    names = [n for n in ("k1", "k0") if n in static]
    names += [f"k0_t{k}" for k in range(1, k0_order + 1)]
    names += [f"k1_t{k}" for k in range(1, k1_order + 1)]
    names += [n for n in static if n not in names]
    return ErrorModel(tuple(term(n) for n in names))


def separable_names(channel: Channel) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the coefficients of the model equation that data can and cannot give.

    They are tried in the order in which they matter: each is kept when it can be told from those
    before it. Orders of a polynomial are kept without gaps.
    """
    order = ["k0", "k1"]
    order += [f"{n}_t{k}" for k in range(1, MAX_ORDER + 1) for n in ("k0", "k1")]
    order += list(STATIC_NAMES)
    if not channel.has_input:
        order = [n for n in order if n.startswith("k0")]
    step = max(1, len(channel.record) // EXAMINED)
    record = channel.record.take(np.arange(0, len(channel.record), step))
    kept: list[str] = []
    for name in order:
        family, _, power = name.partition("_t")
        lower = f"{family}_t{int(power) - 1}" if power not in ("", "1") else family
        if power and lower not in kept:
            continue
        model = ErrorModel(tuple(term(n) for n in [*kept, name]))
        if not examine(model, record, model.start_values()).confounded:
            kept.append(name)
    return tuple(kept), tuple(n for n in order if n not in kept)


def _pieces(channel: Channel) -> tuple[list[IntArray], str]:
    """Return the sets of readings to hold out in turn, and what they are in words."""
    runs = channel.record.run
    if runs[-1] > 0:
        return [np.flatnonzero(runs == r) for r in range(int(runs[-1]) + 1)], "each run in turn"
    parts = np.array_split(np.arange(len(runs)), PIECES)
    return [
        np.asarray(p, dtype=np.intp) for p in parts
    ], "each tenth of the one run in turn, for want of a second run"


class _Folded:
    """The largest model's products, compressed for each held-out piece once."""

    def __init__(
        self,
        channel: Channel,
        static: Sequence[str],
        top0: int,
        top1: int,
        pieces: Sequence[IntArray],
    ) -> None:
        self.static, self.top1 = static, top1
        self.full = equation(static, top0, top1)
        record = channel.record
        output = np.asarray(record.output)[:, None]
        products = self.full.design(record, self.full.start_values())[0].products()
        self.parts = [compress(products[p], output[p]) for p in pieces]
        self.sizes = [len(p) for p in pieces]

    def trial(self, k0_order: int, k1_order: int) -> OrderTrial:
        """Return how a pair of orders does, in sample and held out."""
        model = equation(self.static, k0_order, k1_order)
        columns = self._columns(model)
        start = model.start_values()
        n = sum(self.sizes)
        _, whole = self._fit(model, columns, start, range(len(self.parts)))
        total = 0.0
        for k, part in enumerate(self.parts):
            rest = [j for j in range(len(self.parts)) if j != k]
            values, _ = self._fit(model, columns, start, rest)
            weights = model.product_weights(values)[0][0]
            left = part.target[:, 0] - part.triangle[:, columns] @ weights
            total += float(left @ left + part.rest2[0])
        return OrderTrial(
            k0_order=k0_order,
            k1_order=k1_order,
            residual_ug=1e6 * float(np.sqrt(whole / n)),
            heldout_ug=1e6 * float(np.sqrt(total / n)),
        )

    def _fit(
        self,
        model: ErrorModel,
        columns: Sequence[int],
        start: Mapping[str, float],
        used: Sequence[int],
    ) -> tuple[FloatArray, float]:
        triangle = np.vstack([self.parts[j].triangle[:, columns] for j in used])
        target = np.vstack([self.parts[j].target for j in used])
        values, _, cost = solve_compressed(model, compress(triangle, target), start)
        return values, float(cost[0] + sum(self.parts[j].rest2[0] for j in used))

    def _columns(self, model: ErrorModel) -> list[int]:
        """Return where a smaller model's products stand among the largest one's."""

        def places(kind: str) -> list[int]:
            of_full = [c.name for c in self.full.coefficients_in(kind)]  # type: ignore[arg-type]
            mine = [c.name for c in model.coefficients_in(kind)]  # type: ignore[arg-type]
            return [0, *(1 + of_full.index(name) for name in mine)]

        width = 1 + len(self.full.coefficients_in("input"))
        return [s * width + i for s in places("scale") for i in places("input")]
