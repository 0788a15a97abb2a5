"""Whitening of slow noise, against the dense covariance."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg

from errormodel.noise.model import NoiseModel, drifting, flicker, walking
from errormodel.noise.whitening import TimeBase
from errormodel.record import Record
from tests.errormodel.discrepancy.examples import time_base

BASE = time_base(runs=2, n=40)
SHAPES = {
    "white": NoiseModel(),
    "drift": drifting(4.0, 900.0),
    "flicker": flicker(0.7, BASE),
    "walk": walking(9.0, BASE, continued=False),
    "walk that goes on": walking(9.0, BASE, continued=True),
}


def covariance(shape: NoiseModel, base: TimeBase) -> np.ndarray:
    time_s = base.elapsed_s if shape.continued else base.time_s
    same = np.ones((len(base),) * 2) if shape.continued else base.run[:, None] == base.run
    total = np.diag(base.white2)
    for variance, tau_s in zip(shape.processes.variance, shape.processes.tau_s, strict=True):
        apart = np.exp(-np.abs(time_s[:, None] - time_s) / tau_s)
        if (
            not shape.processes.settled
        ):  # begun from zero: what the start would have left is taken off
            apart = apart - np.exp(-(time_s[:, None] + time_s) / tau_s)
        total = total + variance * apart * same
    return total


@pytest.mark.parametrize("name", SHAPES)
def test_whitening_is_the_inverse_cholesky_factor(name: str) -> None:
    shape = SHAPES[name]
    factor = linalg.cholesky(covariance(shape, BASE), lower=True)
    columns = np.random.default_rng(3).standard_normal((len(BASE), 4))
    whitener = shape.whitener(BASE)
    expected = linalg.solve_triangular(factor, columns, lower=True)
    assert_allclose(whitener.whiten(columns), expected, atol=1e-9)
    assert_allclose(whitener.log_det, 2 * np.log(np.diag(factor)).sum(), rtol=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_colouring_undoes_whitening(name: str) -> None:
    whitener = SHAPES[name].whitener(BASE)
    columns = np.random.default_rng(4).standard_normal((len(BASE), 3))
    assert_allclose(whitener.colour(whitener.whiten(columns)), columns, atol=1e-10)


def test_a_walk_from_zero_counts_with_what_it_moves_within_a_run() -> None:
    # a walk of variance q·t has the mean square q·T/2 over a run of T; its `ratio2` is q·T
    assert_allclose(walking(9.0, BASE, continued=False).slow_share(BASE.span_s), 4.5, rtol=0.02)


@pytest.mark.parametrize("name", ["white", "drift", "flicker", "walk"])
def test_columns_in_blocks_are_whitened_as_when_they_stand_whole(name: str) -> None:
    noise = SHAPES[name]
    record = Record(time_s=BASE.time_s, run=BASE.run, signals={})
    columns = np.random.default_rng(5).standard_normal((len(BASE), 3))
    whitener = noise.block_whitener(3)
    edges = [0, 7, 40, 55, len(BASE)]  # within runs and where the second begins
    parts = [slice(a, b) for a, b in pairwise(edges)]
    white = np.vstack([whitener.whiten(record.view(p), columns[p]) for p in parts])
    whole = noise.whitener(BASE)
    assert_allclose(white, whole.whiten(columns), atol=1e-12)
    assert_allclose(whitener.log_det, whole.log_det, rtol=1e-12, atol=1e-12)


def test_a_walk_that_goes_on_between_runs_needs_the_whole_time_base() -> None:
    with pytest.raises(ValueError, match="needs a common time base"):
        SHAPES["walk that goes on"].block_whitener(1)


def test_the_state_form_of_drift_has_its_covariance() -> None:
    noise = NoiseModel(white=2.0, drift=3.0, drift_tau_s=400.0)
    keep, sigma = noise.drift_step(150.0)
    assert_allclose(keep, np.exp(-150.0 / 400.0))
    assert_allclose(keep**2 * noise.drift**2 + sigma**2, noise.drift**2)  # it stays stationary
