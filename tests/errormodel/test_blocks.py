"""Long records in blocks: the same columns, fits and noise as in one piece."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from errormodel import blocks, columns
from errormodel.columns import derivative
from errormodel.fit import fit, fit_values
from errormodel.model import ErrorModel
from errormodel.noise.drift import NoiseModel
from errormodel.record import Record
from thermo.library import term

NAMES = ("k1", "k1_t1", "k0", "k0_t1", "thermal_lag", "bias_hysteresis", "turn_on_offset_1")
START = {"thermal_lag": 90.0, "bias_hysteresis_width": 8.0}


def long_record() -> tuple[ErrorModel, Record, dict[str, float]]:
    n, rng = 700, np.random.default_rng(4)
    time_s = np.arange(n) * 20.0
    ramp = np.interp(time_s, [0, time_s[-1] / 2, time_s[-1]], [-40.0, 40.0, -40.0])
    angle = np.deg2rad(np.tile(rng.choice([0.0, 90.0, 180.0, 270.0], n), 2))
    x = np.concatenate([ramp, -ramp])
    signals = {"a_i_g": np.sin(angle), "a_p_g": np.cos(angle), "x_c": x, "x_slow_c": x}
    model = ErrorModel(tuple(term(name) for name in NAMES))
    values = {**model.start_values(), **START}
    values |= {"k0": 1e-3, "k0_t1": -7e-6, "k1_t1": 8e-5, "bias_hysteresis": 4e-5}
    inputs = Record(time_s=np.tile(time_s, 2), run=np.repeat([0, 1], n), signals=signals)
    drift = NoiseModel(white=5e-6, drift=4e-6, drift_tau_s=3000.0).sample(inputs, rng)
    output = model.simulate(inputs, values) + drift
    return (
        model,
        Record(time_s=inputs.time_s, run=inputs.run, signals=signals, output=output),
        values,
    )


@pytest.mark.parametrize("block", [64, 700, 701, 999])
def test_memory_is_carried_from_block_to_block_and_not_from_run_to_run(monkeypatch, block):
    model, record, values = long_record()
    output, derivative = model.linearise(record, values)
    simulated = model.simulate(record, values)
    monkeypatch.setattr(blocks, "BLOCK", block)
    assert_allclose(model.simulate(record, values), simulated, rtol=1e-14, atol=1e-17)
    in_blocks = model.linearise(record, values)
    assert_allclose(in_blocks[0], output, rtol=1e-14, atol=1e-17)
    assert_allclose(in_blocks[1], derivative, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("block", [64, 700, 999])
def test_columns_that_are_evaluated_in_blocks_multiply_as_the_whole_does(monkeypatch, block):
    model, record, values = long_record()
    # nonlinear parameters are differenced over the whole record: a model without them
    model = ErrorModel(tuple(t for t in model.terms if not t.parameters))
    whole = derivative(model, record, values)
    monkeypatch.setattr(blocks, "BLOCK", block)
    monkeypatch.setattr(columns, "KEPT", 0)
    parted = columns.Columns(model, record, values)
    assert parted.shape == whole.shape
    rng = np.random.default_rng(0)
    one, many = rng.standard_normal(len(record)), rng.standard_normal((len(record), 3))
    factors = rng.standard_normal((whole.shape[1], 2))
    # of sums of 1400 terms of order one
    close = {"rtol": 1e-12, "atol": 1e-10}
    assert_allclose(parted @ factors, whole @ factors, **close)
    assert_allclose(parted @ factors[:, 0], whole @ factors[:, 0], **close)
    assert_allclose(parted.transposed_times(one), whole.T @ one, **close)
    assert_allclose(parted.transposed_times(many), whole.T @ many, **close)
    assert_allclose(one @ parted, one @ whole, **close)
    assert_allclose(many.T @ parted, many.T @ whole, **close)
    assert_allclose(np.asarray(parted), whole, rtol=1e-13, atol=1e-15)
    by_run = [whole[rows].T @ one[rows] for rows in record.run_slices]
    assert_allclose(parted.by_run(one), by_run, **close)
    triangle, joint = parted.triangle(many), np.hstack([whole, many])
    assert_allclose(triangle.T @ triangle, joint.T @ joint, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("block", [333, 700])
def test_a_fit_in_blocks_finds_the_same_values_sigmas_and_noise(monkeypatch, block):
    _, record, _ = long_record()
    plain = ErrorModel(tuple(term(n) for n in ("k1", "k1_t1", "k0", "k0_t1")))
    whole = fit(plain, record, weighting="noise")
    monkeypatch.setattr(blocks, "BLOCK", block)
    parted = fit(plain, record, weighting="noise")
    # sums in another order: far below a sigma
    assert_allclose(parted.values, whole.values, atol=1e-4 * float(whole.sigmas.min()))
    assert_allclose(parted.sigmas, whole.sigmas, rtol=1e-4)
    assert_allclose(parted.noise.drift, whole.noise.drift, rtol=1e-3)
    assert whole.noise.drift > 0.0


def test_values_alone_are_those_of_a_fit():
    _, record, _ = long_record()
    plain = ErrorModel(tuple(term(n) for n in ("k1", "k1_t1", "k0", "k0_t1")))
    assert fit_values(plain, record) == fit(plain, record).as_dict()
