"""Noise drawn for a record, apart from the whitener that is tested with it."""

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.noise.model import NoiseModel
from errormodel.record import Record


def sampled(noise: NoiseModel, record: Record, rng: np.random.Generator) -> FloatArray:
    """Return noise with one drift, shape (n,); each run's drift starts settled."""
    made = noise.white * rng.standard_normal(len(record))
    if noise.drift == 0.0:
        return made
    for readings in record.run_slices:
        keep = np.exp(-np.diff(record.time_s[readings]) / noise.drift_tau_s)
        kicks = rng.standard_normal(keep.size + 1)
        state = kicks[0]
        drift = [state]
        for k, kick in zip(keep, kicks[1:], strict=True):
            state = k * state + np.sqrt(1.0 - k * k) * kick
            drift.append(state)
        made[readings] += noise.drift * np.array(drift)
    return made
