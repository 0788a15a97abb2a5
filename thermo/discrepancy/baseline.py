"""The present model of an accelerometer when none is given."""

from errormodel.model import ErrorModel
from thermo.recording.channel import Channel
from thermo.selection.orders import equation, select_model, separable_names


def fitted_baseline(channel: Channel) -> ErrorModel:
    """Return the equation that `fit` chooses for these runs.

    The static terms of IEEE 1293 that the positions separate, and the orders of temperature that
    predict runs they were not fitted to.
    """
    return select_model(channel).model


def bare_baseline(channel: Channel) -> ErrorModel:
    """Return k0 and, with a known input, k1, quadratic in temperature if determined."""
    names, _ = separable_names(channel)
    top = {f: next(k for k in (2, 1, 0) if k == 0 or f"{f}_t{k}" in names) for f in ("k0", "k1")}
    static = [n for n in ("k1", "k0") if n in names]
    return equation(static, top["k0"], top["k1"] if channel.has_input else 0)
