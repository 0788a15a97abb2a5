"""How fast the joint fit is, against its peers on the same data, in one run.

    .venv/bin/python -m benchmarks.bench_fit

Prints medians and ratios. The peers are numpy.linalg.lstsq on the linearised columns (no physical
coefficients, no noise, no refusal: the least that any fit can cost) and lmfit's Minimizer
(Levenberg-Marquardt on the same model equation, differences for derivatives).
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: ratios, not the core count

import statistics
import time
from collections.abc import Callable

import lmfit
import numpy as np

from benchmarks.fit_many import fit_many
from errormodel.fit import fit
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from errormodel.record import Record
from thermo.library import term

NAMES = ("k1", "k1_t1", "k1_t2", "k0", "k0_t1", "k0_t2", "k2", "delta_o")
TRUTH = dict(zip(NAMES, (1.002, 8e-5, 3e-7, -4e-4, -7e-6, -6e-8, 2e-5, 3e-4), strict=True))


def median_s(work: Callable[[], object], repeats: int = 5) -> float:
    """Return the median time of some repeats after one to warm up."""
    work()
    times: list[float] = []
    for _ in range(repeats):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return statistics.median(times)


def make_record(n: int, channels: int | None = None) -> tuple[ErrorModel, Record]:
    """Return the model and a tumbled ramp of n readings, with one output or many."""
    rng = np.random.default_rng(0)
    time_s = np.arange(n) * 0.2
    x = np.interp(time_s, [0, time_s[-1] / 2, time_s[-1]], [-65.0, 45.0, -65.0])
    angle = np.deg2rad(rng.choice([0.0, 90.0, 180.0, 270.0, 45.0, 225.0], n))
    signals = {"a_i_g": np.sin(angle), "a_p_g": np.cos(angle), "x_c": x}
    model = ErrorModel(tuple(term(name) for name in NAMES))
    clean = model.simulate(Record(time_s=time_s, signals=signals), TRUTH)
    shape = (n,) if channels is None else (n, channels)
    noise = 5e-6 * rng.standard_normal(shape)
    output = (clean if channels is None else clean[:, None]) + noise
    return model, Record(time_s=time_s, signals=signals, output=output)


def bench_single(n: int = 100_000) -> None:
    """Eight coefficients, 10⁵ readings."""
    model, record = make_record(n)
    y, s = np.asarray(record.output), record.signals
    x, a, p = s["x_c"], s["a_i_g"], s["a_p_g"]
    columns = np.column_stack([a, x * a, x**2 * a, np.ones(n), x, x**2, a**2, p])

    def residual(v: lmfit.Parameters) -> np.ndarray:
        k0 = v["k0"] + v["k0_t1"] * x + v["k0_t2"] * x**2
        k1 = v["k1"] * (1 + v["k1_t1"] * x + v["k1_t2"] * x**2)
        return (y - k1 * (k0 + a + v["k2"] * a**2 + v["delta_o"] * p)) / 5e-6

    start = lmfit.Parameters()
    for name, value in TRUTH.items():
        start.add(name, value=1.0 if name == "k1" else 0.9 * value)

    white = NoiseModel(white=5e-6)
    ours = median_s(lambda: fit(model, record, noise=white))
    drift = median_s(lambda: fit(model, record), 3)
    plain = median_s(lambda: np.linalg.lstsq(columns, y, rcond=None))
    peer = median_s(lambda: lmfit.minimize(residual, start), 3)
    print(f"joint fit, 8 coefficients × {n} readings")
    print(f"  accelbench, noise given        {1e3 * ours:8.1f} ms")
    print(f"  accelbench, noise estimated    {1e3 * drift:8.1f} ms")
    print(f"  numpy.linalg.lstsq             {1e3 * plain:8.1f} ms   ours / it: {ours / plain:.2f}")
    print(f"  lmfit                          {1e3 * peer:8.1f} ms   it / ours: {peer / ours:.1f}")
    found, other = fit(model, record, noise=white), lmfit.minimize(residual, start)
    apart = max(abs(other.params[c].value - found.value(c)) / found.sigma(c) for c in NAMES)
    print(f"  largest difference to lmfit    {apart:.2g} sigma")


def bench_many(channels: int = 1000, n: int = 2000) -> None:
    """A thousand accelerometers that shared a chamber, in one call and in a loop."""
    model, record = make_record(n, channels)
    white, outputs = NoiseModel(white=5e-6), np.asarray(record.output)

    def loop(count: int) -> None:
        for k in range(count):
            one = Record(time_s=record.time_s, signals=record.signals, output=outputs[:, k])
            fit(model, one, noise=white)

    together = median_s(lambda: fit_many(model, record), 3)
    each = median_s(lambda: loop(50), 3) * channels / 50
    print(f"{channels} accelerometers × {n} readings sharing a chamber")
    print(f"  one call                       {1e3 * together:8.1f} ms")
    print(
        f"  a loop (50 of them, scaled up) {1e3 * each:8.1f} ms   it / call: {each / together:.1f}"
    )


if __name__ == "__main__":
    bench_single()
    bench_many()
