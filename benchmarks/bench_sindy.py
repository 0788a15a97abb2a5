"""How often the search is right, and how long it takes, beside sparse regression on the same data.

    .venv/bin/pip install 'accelbench[bench]'
    PYTHONPATH=. .venv/bin/python benchmarks/bench_sindy.py [--sets 20]

The peer is pysindy's STLSQ (Brunton, Proctor and Kutz 2016) on the linear part of the library:
effects without a nonlinear parameter. It is given what helps it: the present model's columns are
projected out, columns have unit length, columns that these runs cannot tell apart are one, the
threshold is the one that predicts left-out runs best.
A set is right when exactly the hidden effect is named (for the search also within an alias set),
or nothing where nothing is hidden. Processor time, one core. Last, the time of the whole search
with its calibration on four runs of 1,200 readings, by the clock.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: one core for either

import argparse
import time
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from pysindy.optimizers import STLSQ

from errormodel.arrays import FloatArray
from errormodel.noise.model import NoiseModel
from tests.thermo.discrepancy.examples import hidden_runs
from thermo.discrepancy.baseline import bare_baseline
from thermo.discrepancy.find import find_discrepancy
from thermo.discrepancy.problem.source import ThermalSource
from thermo.library import thermal_library
from thermo.recording.channel import channel_of
from thermo.recording.files import RecordedRuns

# effect, what it is in the simulator, size
HIDDEN: Sequence[tuple[str, Mapping[str, float]]] = (
    ("", {}),
    ("temperature_rate_bias", {"rate": 8.0}),
    ("second_order", {"k2": 5.0}),
    ("bias_temperature_order", {"order": 30.0}),
    ("cross_axis", {"cross": 4.0}),
)
LINEAR = (
    "temperature_rate_bias", "temperature_rate_scale", "bias_temperature_order",
    "scale_temperature_order", "second_order", "third_order", "cross_axis", "bias_drift",
    "indexer_harmonic", "output_nonlinearity",
)  # fmt: skip
THRESHOLDS = np.geomspace(0.05, 20.0, 16)  # µg rms of an effect over the readings


def columns_of(runs: RecordedRuns) -> tuple[FloatArray, FloatArray, list[str], FloatArray]:
    """Return the linear effects' columns and the residual beside the baseline, names, runs."""
    channel = channel_of(runs, "A")
    effects = [e for e in thermal_library().effects if e.name in LINEAR]
    source = ThermalSource(channel, bare_baseline(channel), effects)
    problem = source.outline(NoiseModel())
    base, _ = np.linalg.qr(problem.base / np.linalg.norm(problem.base, axis=0))
    blocks: list[FloatArray] = []
    names: list[str] = []
    for candidate in problem.candidates:
        own = candidate.grid_signatures[0].columns
        left = own - base @ (base.T @ own)
        shown = np.linalg.norm(left, axis=0) > 2e-3 * np.linalg.norm(own, axis=0)
        blocks.append(left[:, shown] / np.sqrt(np.mean(left[:, shown] ** 2, axis=0)))
        names += [candidate.name] * int(shown.sum())
    x = np.hstack(blocks)
    kept: list[int] = []
    for k in range(x.shape[1]):  # of columns that are the same here, the first stands for all
        rest = x[:, k] - x[:, kept] @ np.linalg.lstsq(x[:, kept], x[:, k])[0] if kept else x[:, k]
        if np.linalg.norm(rest) > 0.05 * np.linalg.norm(x[:, k]):
            kept.append(k)
    residual = problem.residual - base @ (base.T @ problem.residual)
    return x[:, kept], residual, [names[k] for k in kept], problem.times.run.astype(float)


def sparse(x: FloatArray, y: FloatArray, threshold: float) -> FloatArray:
    """Return the coefficients that STLSQ keeps."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that nothing is kept is an answer
        fitted = STLSQ(threshold=threshold, alpha=0.0).fit(x, y[:, None])
    return np.asarray(fitted.coef_).reshape(-1)


def named_by_sindy(runs: RecordedRuns) -> set[str]:
    """Return the effects that STLSQ keeps, its threshold chosen on left-out runs."""
    x, y, names, run = columns_of(runs)
    losses = [
        sum(
            float(np.sum((y[run == r] - x[run == r] @ sparse(x[run != r], y[run != r], t)) ** 2))
            for r in np.unique(run)
        )
        for t in THRESHOLDS
    ]
    kept = sparse(x, y, float(THRESHOLDS[int(np.argmin(losses))]))
    return {n for n, c in zip(names, kept, strict=True) if c != 0.0}


def named_by_search(runs: RecordedRuns) -> set[str]:
    """Return the effects named; an alias set stands as one name with bars."""
    library = [e for e in thermal_library().effects if e.name in LINEAR]
    (d,) = find_discrepancy(runs, model="bare", effects=library)
    if d.alias_sets:
        return {"|".join(s) for s in d.alias_sets}
    return {e.name for e in d.effects}


def is_right(said: set[str], hidden: str) -> bool:
    if not hidden:
        return not said
    return len(said) == 1 and hidden in next(iter(said)).split("|")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=20)
    sets = parser.parse_args().sets
    peers = {"discrepancy": named_by_search, "pysindy STLSQ": named_by_sindy}
    right = {(p, d): [0, 0] for p in peers for d in (0.0, 3.0)}
    nulls = {p: [0, 0] for p in peers}
    spent: dict[str, list[float]] = {p: [] for p in peers}
    for peer in peers.values():
        peer(hidden_runs(999, every_45=True))  # compiled once
    for k in range(sets):
        hidden, sizes = HIDDEN[k % len(HIDDEN)]
        drift_ug = (0.0, 3.0)[(k // len(HIDDEN)) % 2]
        runs = hidden_runs(1000 + k, sizes, every_45=True, drift_ug=drift_ug)
        for name, peer in peers.items():
            begun = time.process_time()
            said = peer(runs)
            spent[name].append(time.process_time() - begun)
            count = right[name, drift_ug] if hidden else nulls[name]
            count[0] += is_right(said, hidden)
            count[1] += 1
            print(f"{k + 1:3d} {hidden or 'nothing':24s} {name:14s} {', '.join(sorted(said))}")
    print("\nright | white noise | white + 3 µg drift | nothing hidden | processor s a set")
    for name in peers:
        cells = [f"{a} of {b}" for a, b in (right[name, 0.0], right[name, 3.0], nulls[name])]
        print(f"{name} | {' | '.join(cells)} | {np.median(spent[name]):.2f}")
    whole()


def whole() -> None:
    """Time the whole search, all of the library, on four runs of 1,200 readings."""
    runs = hidden_runs(1, {"loop": 15.0}, every_45=True)
    kept = np.zeros(len(runs), dtype=bool)
    for code in np.unique(runs.run.codes):
        kept[np.flatnonzero(runs.run.codes == code)[:1200]] = True
    runs = runs.take(kept)
    begun, cpu = time.perf_counter(), time.process_time()
    (d,) = find_discrepancy(runs)
    print(
        f"whole search, {len(runs)} readings, 300 nulls: {time.perf_counter() - begun:.1f} s by "
        f"the clock, {time.process_time() - cpu:.1f} s of processor; {d.verdict}"
    )


if __name__ == "__main__":
    main()
