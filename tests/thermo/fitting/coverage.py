"""How often 1.96 of a stated sigma hold the truth, over many campaigns whose runs differ.

    python -m tests.thermo.fitting.coverage --seeds 300

Four kinds of sigma: of coefficients, of compensated readings of a run that was not fitted, of the
held-out residual and of heating minus cooling. The seeds begin where no threshold was looked at.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tests.thermo.fitting.strange_runs import TRUE, Setup, campaign, output_of
from thermo.compensation.compensate import compensate
from thermo.compensation.model_file import ModelFile, make_model_file, reported
from thermo.fitting.fit import AccelerometerFit, TermsFile, fit_runs

FIRST_SEED = 10_000
Z95 = 1.959964
DIFFERENCES: dict[str, dict[str, float]] = {
    "nothing": {},
    "K0 by 30 µg": {"offset_ug": 30.0},
    "K1 by 30 ppm": {"scale_ppm": 30.0},
    "thermistor by 0.1 °C": {"thermistor_c": 0.1},
}
RUNS = (2, 4, 8)
GIVEN = TermsFile(terms=tuple(TRUE))


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """Deviations over their sigmas, a campaign a row.

    Attributes
    ----------
    coefficients : dict of str to list of float
    chi2 : list of float
        Of all coefficients by their covariance, over their number.
    readings : list of float
        Share of a new run's compensated readings within 1.96 sigma.
    held_out, loop : list of float
    right_orders : list of bool
    """

    coefficients: dict[str, list[float]] = field(default_factory=dict)
    chi2: list[float] = field(default_factory=list)
    readings: list[float] = field(default_factory=list)
    held_out: list[float] = field(default_factory=list)
    loop: list[float] = field(default_factory=list)
    right_orders: list[bool] = field(default_factory=list)
    false_pointers: list[bool] = field(default_factory=list)

    def shares(self) -> dict[str, float]:
        """Return the share within 1.96 sigma by kind."""
        every = np.array([z for of in self.coefficients.values() for z in of])
        return {
            "coefficients": _within(every),
            "readings": float(np.mean(self.readings)),
            "held out": _within(np.array(self.held_out)),
            "heating − cooling": _within(np.array(self.loop)),
        }


def _within(z: np.ndarray) -> float:
    return float(np.mean(np.abs(z) < Z95))


def cover(setup: Setup, seeds: Sequence[int], *, terms: TermsFile | None = None) -> Coverage:
    """Fit campaigns of a set-up and hold every stated sigma against the truth."""
    made = Coverage()
    for seed in seeds:
        (one,) = fit_runs(campaign(setup, seed), terms=terms)
        found = reported(one.fit, setup.nominal, "mA")
        off = [float(v["value"]) - setup.truth.get(n, 0.0) for n, v in found.items()]
        for (name, v), by in zip(found.items(), off, strict=True):
            made.coefficients.setdefault(name, []).append(by / float(v["sigma"]))
        models = make_model_file([one])
        made.chi2.append(_chi2(np.array(off), np.array(models.accelerometers[0].covariance)))
        made.readings.append(_readings_within(setup, models, seed))
        if one.heldout and one.heldout_sigma_ug:
            by = one.heldout.rms_ug - true_rms_ug(setup, models)
            made.held_out.append(by / one.heldout_sigma_ug)
        if one.doubts.loop_sigma_ug:
            left = one.summary.heating_minus_cooling_ug
            made.loop.append((left or 0.0) / one.doubts.loop_sigma_ug)
        made.right_orders.append(_orders(one) == (2, 2))
        made.false_pointers.append(bool(one.doubts.left_out or one.doubts.odd_run))
    return made


def _chi2(off: np.ndarray, cov: np.ndarray) -> float:
    """Return χ² over its degrees of freedom; scaled, because the units are apart by 1e10."""
    scale = np.sqrt(np.diag(cov))
    z = off / scale
    return float(z @ np.linalg.solve(cov / np.outer(scale, scale), z)) / off.size


def _orders(one: AccelerometerFit) -> tuple[int, int]:
    return (one.selection.k0_order, one.selection.k1_order) if one.selection else (2, 2)


def _readings_within(setup: Setup, models: ModelFile, seed: int) -> float:
    runs = campaign(replace(setup, runs=1), seed + 5_000_000, first=50)
    done = compensate(runs, models)
    off = done.accel_compensated_g - np.sin(np.deg2rad(runs.position_deg))
    return _within(off / done.accel_sigma_g)


def true_rms_ug(setup: Setup, models: ModelFile) -> float:
    """Return what a model leaves of runs that it was not fitted to, in the mean of many, µg."""
    still = replace(
        setup, runs=1, white_ug=0.0, drift_ug=0.0, offset_ug=0.0, scale_ppm=0.0, thermistor_c=0.0,
        thermistor_noise_c=0.0,
    )  # fmt: skip
    runs = campaign(still, 1)
    angle = np.deg2rad(runs.position_deg)
    model_off = 1e6 * (compensate(runs, models).accel_compensated_g - np.sin(angle))
    up, down = (output_of(setup.truth, runs.temp_c + s, runs.position_deg) for s in (0.5, -0.5))
    slope_ug = 1e6 * (up - down) / setup.truth["k1"]
    return float(np.sqrt(np.mean(
        model_off**2 + setup.white_ug**2 + setup.drift_ug**2 + setup.offset_ug**2
        + (setup.scale_ppm * np.sin(angle)) ** 2
        + (setup.thermistor_c**2 + setup.thermistor_noise_c**2) * slope_ug**2
    )))  # fmt: skip


def told(name: str, runs: int, made: Coverage) -> str:
    """Return a line of the table."""
    shares = "  ".join(f"{n} {100 * s:5.1f}" for n, s in made.shares().items())
    each = " ".join(f"{n} {100 * _within(np.array(z)):.0f}" for n, z in made.coefficients.items())
    return (
        f"{name}, {runs} runs: {shares}  χ²/n {np.median(made.chi2):.2f}  "
        f"orders 2, 2 in {sum(made.right_orders)} of {len(made.right_orders)}, "
        f"false pointers {sum(made.false_pointers)}\n    {each}"
    )


def first_seed(differs: str, runs: int, first: int = FIRST_SEED) -> int:
    """Return where the seeds of a row begin: no row shares its noise with another."""
    return first + 1000 * (10 * list(DIFFERENCES).index(differs) + runs)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Coverage of stated sigmas.")
    parser.add_argument("--seeds", type=int, default=300)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    parser.add_argument("--step", type=float, default=10.0, help="s between readings")
    parser.add_argument("--given", action="store_true", help="orders given, not chosen")
    parser.add_argument("--runs", type=int, nargs="*", default=RUNS)
    parser.add_argument("--only", nargs="*", default=list(DIFFERENCES))
    asked = parser.parse_args(argv)
    worst = 0.0
    for name in asked.only:
        for runs in asked.runs:
            setup = Setup(runs=runs, step_s=asked.step, **DIFFERENCES[name])
            first = first_seed(name, runs, asked.first)
            seeds = range(first, first + asked.seeds)
            made = cover(setup, seeds, terms=GIVEN if asked.given else None)
            sys.stdout.write(told(name, runs, made) + "\n")
            sys.stdout.flush()
            worst = max(worst, *(abs(s - 0.95) for s in made.shares().values()))
    return 0 if worst <= 0.02 else 1


if __name__ == "__main__":
    sys.exit(main())
