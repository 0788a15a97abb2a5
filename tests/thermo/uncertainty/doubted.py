"""Fits of simulated campaigns, their errors and what is said beside them."""

import numpy as np

from accelbench.commands.fit.text import fit_sentences
from tests.thermo.fitting.strange_runs import Setup, campaign
from thermo.compensation.compensate import compensate
from thermo.compensation.model_file import make_model_file, reported
from thermo.fitting.fit import AccelerometerFit, fit_runs

HEATING = (-40.0, 70.0)
STAGES = (-40.0, -20.0, 0.0, 20.0, 40.0, 55.0, 70.0)


KEPT: dict[str, AccelerometerFit] = {}  # several tests look at the same fit; none changes it


def fitted(setup: Setup, seed: int = 1) -> AccelerometerFit:
    key = f"{setup} {seed}"
    if key not in KEPT:
        if len(KEPT) == 16:
            KEPT.clear()
        (KEPT[key],) = fit_runs(campaign(setup, seed))
    return KEPT[key]


def deviations(one: AccelerometerFit, setup: Setup) -> dict[str, float]:
    """Return (found − true)/sigma by coefficient."""
    found = reported(one.fit, setup.nominal, "mA")
    return {n: (float(v["value"]) - setup.truth.get(n, 0.0)) / float(v["sigma"])
            for n, v in found.items()}  # fmt: skip


def worst(one: AccelerometerFit, setup: Setup) -> float:
    return max(abs(z) for z in deviations(one, setup).values())


def said(one: AccelerometerFit) -> str:
    return "\n".join(fit_sentences(one))


def error_ug(setup: Setup, one: AccelerometerFit, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of runs not fitted after compensation, and their sigmas, µg."""
    runs = campaign(setup, seed, first=50)
    done = compensate(runs, make_model_file([one]))
    angle = np.deg2rad(runs.position_deg)
    return 1e6 * (done.accel_compensated_g - np.sin(angle)), 1e6 * done.accel_sigma_g
