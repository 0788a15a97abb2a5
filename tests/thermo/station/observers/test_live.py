"""The live estimate during a ramp: the batch one of the same readings, and true in its sigmas."""

import numpy as np

from errormodel.record import Record
from tests.thermo.examples import NOMINAL, TRUTH, simulate_run
from thermo.planning.foresight import ASSUMED_NOISE
from thermo.station.observers.live import LiveEstimate
from thermo.station.observers.live_model import LIVE_TERMS, LiveModel, LiveReading
from thermo.store.records import ReadingRow

QUADRATIC = {**TRUTH, "k0_t3": 0.0, "k2": 0.0, "k3": 0.0, "k_ip": 0.0}


def rows_of_run(frame, flag: str = "") -> list[ReadingRow]:
    return [
        ReadingRow(
            serial="A",
            slot=k,
            time_s=float(r.time_s),
            temp_c=float(r.temp_c),
            position_deg=float(r.position_deg),
            output=float(r.output),
            flag=flag,
        )
        for k, r in enumerate(frame.itertuples())
    ]


def test_it_equals_the_batch_estimate_of_the_same_readings() -> None:
    frame = simulate_run(np.random.default_rng(1), n=600, truth=QUADRATIC)
    live = LiveEstimate({"A": NOMINAL})
    for row in rows_of_run(frame):
        live.on_reading(1, [row])
    model = LiveModel.of(LIVE_TERMS, start={}, t_ref_c=25.0)
    readings = [LiveReading.of(row, 0.0) for row in rows_of_run(frame)]
    columns = np.array([model.step(one)[0] for one in readings if one is not None])
    record = Record(time_s=frame["time_s"], signals={})
    y = np.asarray(frame["output"]) / NOMINAL
    whitened = ASSUMED_NOISE.whiten(record, np.column_stack([columns, y]))
    a, b = whitened[:, :-1], whitened[:, -1]
    information = a.T @ a + np.eye(model.prior.size)
    batch = np.linalg.solve(information, a.T @ b + model.prior)
    sigmas = np.sqrt(np.diag(np.linalg.inv(information)))
    fit = live.fit_of("A")
    # the comparison's own normal equations keep five digits of a sigma
    assert np.max(np.abs(fit.values - batch) / sigmas) < 1e-5


def test_k0_and_k1_now_lie_within_their_sigmas() -> None:
    z = []
    for seed in range(30):
        frame = simulate_run(np.random.default_rng(seed), n=400, truth=QUADRATIC)
        live = LiveEstimate({"A": NOMINAL})
        live.on_reading(1, rows_of_run(frame.iloc[:300]))
        (value,) = live.values()
        x = value.temp_c - 25.0
        k0 = QUADRATIC["k0"] + QUADRATIC["k0_t1"] * x + QUADRATIC["k0_t2"] * x**2
        k1 = 1 + 1e-6 * (QUADRATIC["k1_t1"] * x + QUADRATIC["k1_t2"] * x**2)
        z.append((value.k0_ug - k0) / value.k0_sigma_ug)
        z.append(1e6 * (value.k1 - QUADRATIC["k1"] / NOMINAL * k1) / value.k1_sigma_ppm)
        assert value.n == 300
    assert 0.5 < np.mean(np.square(z)) < 1.6  # χ² of 60: 4 sigma either way


def test_flagged_unknown_and_repeated_readings_change_nothing() -> None:
    frame = simulate_run(np.random.default_rng(1), n=50)
    live = LiveEstimate({"A": NOMINAL})
    assert live.values() == ()
    good = rows_of_run(frame)
    live.on_reading(1, good)
    before = live.values()
    live.on_reading(1, rows_of_run(frame, flag="moving"))
    live.on_reading(1, good[-1:])
    other = ReadingRow(serial="B", slot=0, time_s=9e9, temp_c=1.0, position_deg=0.0, output=1.0)
    empty = ReadingRow(
        serial="A", slot=99, time_s=9e9, temp_c=None, position_deg=0.0, output=None, flag="open"
    )
    live.on_reading(1, [other, empty])
    assert live.values() == before


def test_a_second_run_goes_on_with_a_fresh_drift() -> None:
    rng = np.random.default_rng(2)
    live = LiveEstimate({"A": NOMINAL})
    live.on_reading(1, rows_of_run(simulate_run(rng, n=400, truth=QUADRATIC)))
    (first,) = live.values()
    live.on_reading(2, rows_of_run(simulate_run(rng, n=400, truth=QUADRATIC)))
    (second,) = live.values()
    assert second.n == 800
    assert second.k0_sigma_ug < first.k0_sigma_ug


def test_k0_lies_within_its_sigma_when_the_accelerometer_has_more_terms_and_a_loop() -> None:
    """Every term of the simulation, and a loop of 30 µg that no live unknown holds."""
    z = []
    for seed in range(10):
        frame = simulate_run(np.random.default_rng(seed), n=400, truth=TRUTH, loop_ug=15.0)
        live = LiveEstimate({"A": NOMINAL})
        live.on_reading(1, rows_of_run(frame))
        (value,) = live.values()
        x = value.temp_c - 25.0
        k0 = sum(TRUTH[f"k0_t{k}"] * x**k for k in (1, 2, 3)) + TRUTH["k0"]
        z.append((value.k0_ug - k0) / value.k0_sigma_ug)
    # one loop each, of which the sigma knows the size: 3 sigma of it are allowed
    assert np.max(np.abs(z)) < 3.0
