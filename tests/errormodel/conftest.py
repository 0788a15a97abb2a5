"""A model, its coefficients and a record that the core's tests share."""

import numpy as np
import pytest

from errormodel.model import ErrorModel
from errormodel.record import Record
from tests.errormodel.examples import linear_term


@pytest.fixture(scope="session")
def model() -> ErrorModel:
    """Gain, bias and two temperature slopes: four unknowns whose products matter."""
    return ErrorModel(
        (
            linear_term("gain", "gain", "x", 0),
            linear_term("bias", "input", "x", 0),
            linear_term("bias_t", "input", "x"),
            linear_term("scale_t", "scale", "x"),
            linear_term("square", "input", "u", 2),
        ),
        base="u",
    )


@pytest.fixture(scope="session")
def truth() -> dict[str, float]:
    return {"gain": 1.02, "bias": -4e-3, "bias_t": 3e-5, "scale_t": 1e-4, "square": 2e-5}


@pytest.fixture(scope="session")
def record() -> Record:
    """Four runs of a four-hour triangle in temperature, tumbled through six inputs at random."""
    n, rng = 360, np.random.default_rng(1)
    time_s = np.tile(np.arange(n) * 40.0, 4)
    x = np.interp(time_s, [0, 7200, 14400], [-65.0, 45.0, -65.0])
    u = rng.choice([0.0, 1.0, -1.0, 0.5, -0.5, 0.7], size=4 * n)
    return Record(time_s=time_s, run=np.repeat(np.arange(4), n), signals={"x": x, "u": u})
