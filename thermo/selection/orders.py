"""Terms that a set of runs supports: separable ones, and the orders that predict held-out runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.fit import ModelFit, examine, fit, whitened_products
from errormodel.linear import compress, compressed, solve_compressed, triangle_of
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from errormodel.run_effects import estimate_run_effects
from thermo.library import MAX_ORDER, STATIC_NAMES, term
from thermo.library.head import remount_name
from thermo.library.polynomial import ORDERS, order_name
from thermo.recording.channel import Channel
from thermo.selection.support import settled

# An order is worth its coefficient when it lowers the held-out rms by this share or more.
WORTH = 0.01
# The same for the whitened sum of squares: a coefficient of three sigma.
WORTH_CHI2 = 9.0
# Drift beyond this many times the white noise is taken for a missing effect that poses as drift:
# nothing is then to be learnt from weighing readings by it.
PLAUSIBLE_DRIFT = 2.0
# With one run only, it is left out in this many pieces, one after another.
PIECES = 10
# The orders a quartz-flexure accelerometer usually wants; lower when the data cannot carry them.
K0_ORDER, K1_ORDER = 3, 2
BY_RUN = ("k0", "k1")  # what may take a new value in each run
EACH_RUN = "each run in turn"
# Enough readings to judge separability; more only repeat the same geometry.
EXAMINED = 4000


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderTrial:
    """Held-out error of one pair of polynomial orders.

    `residual_ug` and `heldout_ug` are rms values over readings, in the fit and held out;
    `heldout_chi2` is the held-out sum of squares after whitening by the noise, drift included.
    """

    k0_order: int
    k1_order: int
    residual_ug: float
    heldout_ug: float
    heldout_chi2: float


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
    bias's and the scale factor's polynomials are judged on held-out runs, each run predicted from
    the others, in two ways: an order is taken when the rms of the prediction falls by 1 %
    (readings counted alike), or when its whitened sum of squares falls by 9 (readings counted as
    the noise and its drift say). The first alone would leave effects below the noise of a reading
    in the coefficients; the second would take a missing effect for drift, so it is left out when
    the drift is implausibly large. A single run is held out piece by piece instead.

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
    full = equation(static, top0, top1)
    pieces, held_out = _pieces(channel, full)
    alike = _Folded(full, channel, NoiseModel(white=1.0), pieces)
    found = fit(full, channel.record, by_run=BY_RUN)
    noise = found.noise
    weighed = _Folded(full, channel, noise, pieces)
    if held_out == EACH_RUN:
        weighed.count_run_effects(found)
    trials = tuple(
        _trial(equation(static, i, j), (i, j), alike, weighed)
        for i in range(top0 + 1)
        for j in range(top1 + 1)
    )
    by_rms = _simplest(trials, min(t.heldout_ug for t in trials) * (1.0 + WORTH), "heldout_ug")
    k0_order, k1_order = by_rms.k0_order, by_rms.k1_order
    if noise.drift <= PLAUSIBLE_DRIFT * noise.white:
        least = min(t.heldout_chi2 for t in trials)
        by_chi2 = _simplest(trials, least + WORTH_CHI2, "heldout_chi2")
        k0_order, k1_order = max(k0_order, by_chi2.k0_order), max(k1_order, by_chi2.k1_order)
    return Selection(
        model=equation(static, k0_order, k1_order),
        k0_order=k0_order,
        k1_order=k1_order,
        trials=trials,
        not_separable=lost,
        held_out=held_out,
    )


def referred_to_input(selection: Selection, k1: float) -> Selection:
    """Return a selection with its residuals referred to the input by a scale factor k1."""
    trials = tuple(
        replace(t, residual_ug=t.residual_ug / k1, heldout_ug=t.heldout_ug / k1)
        for t in selection.trials
    )
    return replace(selection, trials=trials)


def _simplest(trials: Sequence[OrderTrial], at_most: float, measure: str) -> OrderTrial:
    """Return the trial of the fewest coefficients among those that are good enough."""
    good = [t for t in trials if getattr(t, measure) <= at_most]
    return min(good, key=lambda t: (t.k0_order + t.k1_order, getattr(t, measure)))


def _trial(
    model: ErrorModel, orders: tuple[int, int], alike: "_Folded", weighed: "_Folded"
) -> OrderTrial:
    within, heldout = alike.costs(model)
    return OrderTrial(
        k0_order=orders[0],
        k1_order=orders[1],
        residual_ug=1e6 * float(np.sqrt(within / alike.n)),
        heldout_ug=1e6 * float(np.sqrt(heldout / alike.n)),
        heldout_chi2=weighed.costs(model)[1],
    )


def equation(static: Sequence[str], k0_order: int, k1_order: int) -> ErrorModel:
    """Return the model equation with the terms and polynomial orders given."""
    names = [n for n in ("k1", "k0") if n in static]
    names += [f"k0_t{k}" for k in range(1, k0_order + 1)]
    names += [f"k1_t{k}" for k in range(1, k1_order + 1)]
    names += [n for n in static if n not in names]
    return ErrorModel(tuple(term(n) for n in names))


def usual_equation(names: Sequence[str]) -> ErrorModel:
    """Return the model equation with the usual orders, of the coefficients that data can give.

    Parameters
    ----------
    names : sequence of str
        As `separable_names` returns them.
    """
    static = [n for n in names if n in STATIC_NAMES or n in ("k0", "k1")]
    top0, top1 = (
        max([k for k in range(MAX_ORDER + 1) if f"{n}_t{k}" in names], default=0)
        for n in ("k0", "k1")
    )
    return equation(static, min(K0_ORDER, top0), min(K1_ORDER, top1))


def separable_names(channel: Channel) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the coefficients of the model equation that data can and cannot give.

    They are tried in the order in which they matter: each is kept when it can be told from those
    before it. Orders of a polynomial are kept without gaps. A soak counts as one temperature: what
    a thermistor's noise alone would separate is not separable.
    """
    families = ("k0", "k1") if channel.has_input else ("k0",)
    lower = {order_name(n, k): order_name(n, k - 1) for k in ORDERS for n in families}
    order = [*families, *lower, *(STATIC_NAMES if channel.has_input else ())]
    step = max(1, len(channel.record) // EXAMINED)
    still = channel.record.with_signals(x_c=settled(channel))
    record = still.take(np.arange(0, len(still), step))
    kept: list[str] = []
    for name in order:
        if name in lower and lower[name] not in kept:
            continue
        model = ErrorModel(tuple(term(n) for n in [*kept, name]))
        if not examine(model, record, model.start_values()).confounded:
            kept.append(name)
    return tuple(kept), tuple(n for n in order if n not in kept)


def _pieces(channel: Channel, full: ErrorModel) -> tuple[list[slice], str]:
    """Return the sets of readings to hold out in turn, and what they are in words.

    Runs are held out where the others can give the whole model without each of them.
    """
    record = channel.record.with_signals(x_c=settled(channel))
    runs = record.run
    count = int(runs[-1]) + 1
    if count == 1:
        return _tenths(channel), "each tenth of the run in turn, because there is no second run"
    start = full.start_values()
    for number in range(count):
        rest = np.flatnonzero(runs != number)
        rest = rest[:: max(1, rest.size // EXAMINED)]
        if examine(full, record.take(rest), start).confounded:
            lone = channel.run_ids[number]
            return (
                _tenths(channel),
                f"each tenth of the readings in turn: run {lone} has no comparable run",
            )
    return list(channel.record.run_slices), EACH_RUN


def _tenths(channel: Channel) -> list[slice]:
    whole, more = divmod(len(channel.record), PIECES)
    edges = [k * whole + min(k, more) for k in range(PIECES + 1)]
    return [slice(a, b) for a, b in pairwise(edges)]


class _Folded:
    """The largest model's products, compressed for each held-out piece once."""

    def __init__(
        self, full: ErrorModel, channel: Channel, noise: NoiseModel, pieces: Sequence[slice]
    ) -> None:
        self.full = full
        record, output = channel.record, np.asarray(channel.record.output)
        triangles: list[FloatArray | None] = [None] * len(pieces)
        for rows, joint in whitened_products(full, record, output, noise, full.start_values()):
            for k, piece in enumerate(pieces):  # in order, and together the whole record
                a, b = max(piece.start, rows.start), min(piece.stop, rows.stop)
                if a < b:
                    mine = joint[a - rows.start : b - rows.start]
                    triangles[k] = triangle_of(mine, triangles[k])
        self.parts = [compressed(t) for t in triangles if t is not None]
        self.n = len(record)

    def count_run_effects(self, found: ModelFit) -> None:
        """Weigh what a run differs by as its own: K0 and K1 of one run are one reading of them."""
        at = np.array([[found.value(c.name) for c in self.full.coefficients]])
        weights, jacobian = (w[0] for w in self.full.product_weights(at))
        derivatives = [part.triangle @ jacobian for part in self.parts]
        lefts = [part.target[:, 0] - part.triangle @ weights for part in self.parts]
        grams: list[FloatArray] = []
        for part, columns, left in zip(self.parts, derivatives, lefts, strict=True):
            joint = np.column_stack([columns, left])
            gram = joint.T @ joint
            gram[-1, -1] += part.rest2[0]
            grams.append(gram)
        names = [n for n in BY_RUN if n in found.names]
        directions = np.eye(len(found.names))[:, [found.names.index(n) for n in names]]
        even = np.full(len(names), 1.0 / len(grams))
        effects = estimate_run_effects(np.array(grams), directions, names, even, 0.0 * even)
        sigmas = np.array([e.likely for e in effects])
        for k, (part, columns) in enumerate(zip(self.parts, derivatives, strict=True)):
            along = columns @ directions * sigmas
            values, vectors = np.linalg.eigh(np.eye(len(along)) + along @ along.T)
            root = (vectors / np.sqrt(values)) @ vectors.T
            self.parts[k] = replace(part, triangle=root @ part.triangle, target=root @ part.target)

    def costs(self, model: ErrorModel) -> tuple[float, float]:
        """Return the sum of squares of a smaller model in the fit, and held out."""
        columns = self._columns(model)
        start = model.start_values()
        _, within = self._fit(model, columns, start, range(len(self.parts)))
        heldout = 0.0
        for k, part in enumerate(self.parts):
            rest = [j for j in range(len(self.parts)) if j != k]
            values, _ = self._fit(model, columns, start, rest)
            weights = model.product_weights(values)[0][0]
            left = part.target[:, 0] - part.triangle[:, columns] @ weights
            heldout += float(left @ left + part.rest2[0])
        return within, heldout

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


def mounted(model: ErrorModel, channel: Channel) -> ErrorModel:
    """Return the model with the angle of every mounting but the first: none repeats exactly."""
    count = int(channel.record["mounting"].max())
    held = {t.name for t in model.terms}
    wanted = [remount_name(k) for k in range(1, count + 1)]
    return model.with_terms(*(term(n) for n in wanted if n not in held))
