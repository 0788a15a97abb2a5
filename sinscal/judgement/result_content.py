"""Content of the result file of a rig calibration, made of its judgement."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.io.signed import software_name
from sinscal.calibration.consistency import Consistency, Nis
from sinscal.calibration.effect_tests import EffectTests
from sinscal.calibration.hold_out import Shift
from sinscal.calibration.observability import Observability
from sinscal.calibration.rig import RigCalibration
from sinscal.filter.data import RigNoise
from sinscal.judgement.judge import Calibration, Judged
from sinscal.judgement.protection import MISSED
from sinscal.library.angle import MOUNT
from sinscal.recording.run import NavRun, RigRun

# What the tests do not see. The clock: a rate is an angle over its seconds.
CLOCK = ("the recorder's clock (1000 ppm fast is −1000 ppm in every gyro scale)",)
NEVER = ("gravity that differs from the normal one", "two effects that cancel each other")
NO_EFFECTS = (
    "missing effects, so there are no protection levels: only rig calibrate with raw sensors "
    "tests for them"
)
LISTED = 500  # refused measurements; their number is always told


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Estimates:
    """Estimates and what was expected of them, as a result file tells them.

    Attributes
    ----------
    names : tuple of str
    values, cov : ndarray, shape (p,), (p, p)
        In `units`.
    units : mapping of str to str
    prior_mean, prior_sigma : ndarray, shape (p,)
    """

    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    units: Mapping[str, str]
    prior_mean: FloatArray
    prior_sigma: FloatArray

    def __post_init__(self) -> None:
        names = ("values", "cov", "prior_mean", "prior_sigma")
        freeze(self, **{name: readonly(getattr(self, name)) for name in names})


def rig_estimates(found: Calibration) -> Estimates:
    """Return the estimates of a rig calibration as they are, SI."""
    described = [found.described(n) for n in found.names]
    mounts = sum(one.group == MOUNT for one in described)
    sigma = np.sqrt(np.diag(found.prior.cov))
    return Estimates(
        names=found.names,
        values=found.values,
        cov=found.cov,
        units={one.name: one.unit for one in described},
        prior_mean=np.append(found.prior.values, np.zeros(mounts)),
        prior_sigma=np.append(sigma, np.full(mounts, found.prior.mount_sigma_rad)),
    )


def result_content(judged: Judged, run: RigRun | NavRun, told: Estimates) -> dict[str, Any]:
    """Return the fields of `ResultContent` that do not depend on the kind of calibration."""
    found, site = judged.found, run.facts.site
    rows = zip(told.names, told.values.tolist(), np.sqrt(np.diag(told.cov)).tolist(), strict=True)
    priors = zip(told.names, told.prior_mean.tolist(), told.prior_sigma.tolist(), strict=True)
    return {
        "software": software_name(),
        "mode": found.mode,
        "t_ref_c": found.sensors.t_ref_c,
        "gravity_m_s2": found.sensors.gravity_m_s2,
        "parameters": {n: {"value": v, "sigma": s, "unit": told.units[n]} for n, v, s in rows},
        "names": told.names,
        "covariance": told.cov.tolist(),
        "prior": {n: {"mean": m, "sigma": s} for n, m, s in priors},
        "noise": _noise(found),
        "run": {
            "source": Path(run.source).name,
            "digest": run_digest(run),
            "rows": len(run),
            "cycles": len(run.cycles),
            "latitude_deg": float(np.rad2deg(site.lat_rad)),
            "height_m": site.height_m,
        },
        "iterations": found.iterations,
        "converged": judged.consistency.converged,
        "north": _north(found),
        "consistency": consistency_document(judged.consistency),
        "observability": observability_document(judged.observability),
        "refused": _refused(judged),
        "protection": protection_document(judged),
        "drift": [
            {
                "kind": d.kind,
                "family": d.family,
                "sigma": d.sigma,
                "tau_s": d.tau_s,
                "shown": d.shown,
            }
            for d in judged.drifts
        ],
        "not_tested": not_tested(judged),
        "warnings": judged.warnings,
    }


def not_tested(judged: Judged) -> tuple[str, ...]:
    """Return what no test of a calibration sees and no protection level holds, in words."""
    untested = () if judged.consistency.effects else (NO_EFFECTS,)
    return (*untested, *(CLOCK if isinstance(judged.found, RigCalibration) else ()), *NEVER)


def run_digest(run: RigRun | NavRun) -> str:
    """Return the SHA-256 of a run's readings."""
    parts = ("time_s", "cycle", "gyro", "accel", "rig_angle_rad", "temp_c", "flag")
    parts += ("lat_rad", "lon_rad", "height_m", "velocity", "c_nb")
    made = hashlib.sha256()
    for name in parts:
        values = getattr(run, name, None)
        if values is not None:
            made.update(name.encode())
            made.update(np.ascontiguousarray(values).tobytes())
    return made.hexdigest()


def _noise(found: Calibration) -> dict[str, float | None]:
    noise = found.noise
    common = {"gyro_rad_s_rthz": noise.gyro, "accel_m_s2_rthz": noise.accel}
    if isinstance(noise, RigNoise):
        return {
            **common,
            "angle_rad_rthz": noise.angle or None,
            "axis_wobble_rad_rthz": noise.wobble,
            "gyro_instability_rad_s": noise.gyro_instability,
            "accel_instability_m_s2": noise.accel_instability,
            "instability_tau_s": noise.instability_tau_s,
            "gyro_quantum_rad": noise.gyro_quantum,
            "accel_quantum_m_s": noise.accel_quantum,
        }
    return {**common, "velocity_m_s": noise.velocity_m_s, "position_m": noise.position_m}


def _north(found: Calibration) -> tuple[dict[str, float], ...]:
    if not isinstance(found, RigCalibration):
        return ()
    return tuple(
        {"azimuth_deg": float(np.rad2deg(a)), "sigma_deg": float(np.rad2deg(s))}
        for a, s in zip(found.north_azimuth_rad, found.north_sigma_rad, strict=True)
    )


def _nis(nis: Nis) -> dict[str, Any]:
    return {"nis_mean": nis.mean, "nis_interval": list(nis.interval), "n": nis.n}


def _shift(shift: Shift) -> dict[str, Any]:
    return {"shift_chi2": shift.chi2, "dof": shift.dof, "p_value": shift.p_value}


def consistency_document(c: Consistency) -> dict[str, Any]:
    """Return a judgement as the result file holds it."""
    return {
        **_nis(c.nis),
        "passed": c.passed,
        "tests": c.tests,
        "channels": {
            one.name: {**_nis(one.nis), "white_p": one.white_p, "slow_drift_p": one.slow_p}
            for one in c.channels
        },
        "bounded": _nis(c.bounded) if c.bounded else None,
        "prior": _shift(c.prior),
        "effects": _effects(c.effects),
        "held_out": [
            {
                "cycle": held.cycle + 1,
                **_shift(held.shift),
                "force_residual_before_m_s2": held.before_m_s2,
                "force_residual_after_m_s2": held.after_m_s2,
            }
            for held in c.held_out
        ],
    }


def _effects(tests: EffectTests | None) -> dict[str, Any] | None:
    if tests is None:
        return None
    return {
        one.name: {
            "chi2": one.chi2,
            "dof": one.dof,
            "p_value": one.p_value,
            "missing": one in tests.missing,
            "sizes": dict(one.sizes),
        }
        for one in tests.tests
    }


def protection_document(judged: Judged) -> dict[str, Any] | None:
    """Return the protection levels as the result file holds them, in the unit of the parameter."""
    if judged.protection is None:
        return None
    return {
        "missed": MISSED,
        "parameters": {
            name: {
                "total": one.total,
                "covariance": one.covariance,
                "worst": one.worst,
                "effects": dict(one.effects),
            }
            for name, one in judged.protection.items()
        },
        "limits": dict(judged.limits),
        "exceeded": list(judged.unprotected),
    }


def observability_document(o: Observability) -> dict[str, Any]:
    """Return what the data show as the result file holds it."""
    return {
        "singular_values": o.singular_values.tolist(),
        "sigma_ratio": dict(o.sigma_ratio),
        "not_observed": list(o.not_observed),
        "not_told_apart": [dict(one) for one in o.combinations],
        "correlated": [
            {"names": list(p.names), "correlation": p.correlation} for p in o.correlated
        ],
    }


def _refused(judged: Judged) -> dict[str, Any]:
    return {
        "n": len(judged.refused),
        "measurements": [
            {"cycle": r.cycle + 1, "time_s": r.time_s, "channel": r.channel, "sigmas": r.sigmas}
            for r in judged.refused[:LISTED]
        ],
        "flagged_rows_by_cycle": list(judged.flagged),
    }
