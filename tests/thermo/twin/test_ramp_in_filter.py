"""A chamber ramp through the core of the rig's filter gives the chamber's fit."""

import numpy as np

from errormodel.columns import derivative
from errormodel.filter.kalman import initial_state
from errormodel.filter.steps import Steps, run_filter
from errormodel.fit import fit
from errormodel.noise.drift import NoiseModel
from errormodel.record import Record
from thermo.recording.runs import head_force_g
from thermo.twin.accelerometer import emulated_accelerometer

NOISE = NoiseModel(white=5e-6, drift=3e-6, drift_tau_s=3600.0)


def test_the_rig_filter_gives_the_chamber_fit() -> None:
    rng = np.random.default_rng(7)
    made = emulated_accelerometer("ramp")
    model, t = made.model, np.arange(0.0, 8 * 3600.0, 15.0)
    x = np.interp(t, [0.0, 14400.0, 28800.0], [-65.0, 45.0, -65.0])
    force = head_force_g(np.array([0.0, 90, 180, 270, 45, 225])[np.arange(t.size) % 6])
    signals = {"a_i_g": force[:, 0], "a_p_g": force[:, 1], "a_o_g": force[:, 2], "x_c": x}
    bare = Record(time_s=t, signals=signals)
    output = model.simulate(bare, made.values) + NOISE.sample(bare, rng)
    record = Record(time_s=t, signals=signals, output=output)
    batch = fit(model, record, noise=NOISE, weighting="noise")

    # the fit's own linearisation: the filter starts from its values, from which it must not move
    rows = derivative(model, record, batch.as_dict())
    left = output - model.simulate(record, batch.as_dict())
    p = len(model.names)
    h = np.column_stack([np.ones(t.size), rows])[:, None, :]
    keep = np.exp(-15.0 / NOISE.drift_tau_s)
    phi = np.zeros((t.size, 1, p + 1))
    phi[:, 0, 0] = keep
    steps = Steps(
        h=h, z=left[:, None], r=np.full((t.size, 1), NOISE.white**2), phi=phi,
        q=np.full((t.size, 1), NOISE.drift**2 * (1.0 - keep**2)),
    )  # fmt: skip
    # a prior a thousand sigmas wide, off by two fit sigmas: it weighs 1e-6 of the data
    off = 2.0 * batch.sigmas * rng.standard_normal(p)
    wide = np.append(NOISE.drift**2, (1e3 * batch.sigmas) ** 2)
    state = run_filter(initial_state(np.append(0.0, off), wide), steps).state
    assert np.max(np.abs(state.x[1:]) / batch.sigmas) < 1e-3
    np.testing.assert_allclose(state.sigmas[1:], batch.sigmas, rtol=1e-3)
