"""The result of a rig calibration as a file: all that is needed to apply, trust and trace it.

JSON. Values are SI in the order of `names`; `result_id` is a digest of the content.
"""

import hashlib
import json
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.files import check, read_text
from sinscal.calibrate import RigCalibration
from sinscal.consistency import Consistency, Nis
from sinscal.holdout import Shift
from sinscal.judged import Calibration, Judged
from sinscal.observability import GAUGE, Observability
from sinscal.priors import group_of
from sinscal.rig_model_file import BiasStep
from sinscal.rigdata import RigNoise
from sinscal.run import NavRun, RigRun
from sinscal.sensors import SensorModel, sensor_model
from sinscal.terms import BASIC

FORMAT = "accelbench-rig-calibration"
VERSION = 1
MOUNT = "rig_mount_"
FORMULA = (
    "measured = true + error: ω′ = (I + Θ)·ω + ν⁰ + G·f + Θ±·|ω| + νT·x, "
    "f′ = (I + Γ)·f + Δf⁰ + K2·f² + lever(ω, dω/dt) + (ΔfT + ΓT·f)·x, x = T − t_ref_c; what is "
    "not among names is 0. To correct readings solve for ω and f: ω ← ω′ − error(ω, f), "
    "f ← f′ − error(ω, f), from ω′ and f′, until nothing changes (four times)"
)
SIGNS = (
    "gyro_scale_a is Θaa, gyro_misalignment_ab is Θab: what a rate about b adds to gyro a; "
    "accel_misalignment_ab is Γab likewise; lever_arm_a_b is component b of accelerometer a's "
    "sensing mass from the centre of rotation, it adds ([dω/dt ×] + [ω ×]²)·r; specific force at "
    "rest points up; the platform's axes are those of exp(rig_mount ×)·body; the angle in the row "
    "of time t is the platform's at t + rig_time_offset"
)
AXES_TEXT = (
    "the accelerometers define the body frame: z is along accelerometer z's sensitive axis, "
    "y lies in the plane of accelerometers y and z (Γ is lower triangular); right-handed; "
    "east-north-up outside"
)
UNITS = "SI: rad, rad/s, m/s², m, s; scale errors are ratios, misalignments rad"
LISTED = 500  # refused measurements; their number is always told

Finite = Annotated[float, Field(allow_inf_nan=False)]
Sigma = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ParameterValue(_Part):
    """One estimate."""

    value: Finite
    sigma: Sigma
    unit: str


class PriorValue(_Part):
    """What was known of it beforehand."""

    mean: Finite
    sigma: Sigma


class RunFacts(_Part):
    """The run it was made of."""

    source: str
    digest: str
    rows: int
    cycles: int
    latitude_deg: Finite
    height_m: Finite


class RigResult(_Part):
    """RESULT.json of `accelbench rig calibrate`."""

    format: Literal["accelbench-rig-calibration"] = FORMAT
    format_version: Literal[1] = VERSION
    result_id: str = ""
    software: str
    mode: str
    groups: tuple[str, ...]
    steps: tuple[BiasStep, ...] = ()
    t_ref_c: Finite
    gravity_m_s2: Finite
    parameters: dict[str, ParameterValue]
    names: tuple[str, ...]
    covariance: tuple[tuple[Finite, ...], ...]
    prior: dict[str, PriorValue]
    formula: str = FORMULA
    signs: str = SIGNS
    axes: str = AXES_TEXT
    units: str = UNITS
    gauge: str = GAUGE
    noise: dict[str, float | None]
    run: RunFacts
    iterations: int | None
    converged: bool
    north: tuple[dict[str, float], ...] = ()
    consistency: dict[str, Any]
    observability: dict[str, Any]
    refused: dict[str, Any]
    warnings: tuple[str, ...]

    @model_validator(mode="after")
    def _fits(self) -> "RigResult":
        p = len(self.names)
        if tuple(self.parameters) != self.names:
            raise ValueError("names must be those of parameters, in their order")
        if len(self.covariance) != p or any(len(row) != p for row in self.covariance):
            raise ValueError(f"covariance must have {p} rows of {p} numbers")
        try:
            known = self.sensors.names
        except KeyError as err:
            raise ValueError(str(err.args[0])) from None
        own = tuple(n for n in self.names if not n.startswith(MOUNT))
        if own != known:
            raise ValueError("names must be those of groups, in the order of the sensor model")
        return self

    @property
    def sensors(self) -> SensorModel:
        """The sensor model the values belong to."""
        return sensor_model(
            self.groups,
            more=[step.maker for step in self.steps],
            t_ref_c=self.t_ref_c,
            gravity_m_s2=self.gravity_m_s2,
        )

    @property
    def values(self) -> FloatArray:
        """Estimates in the order of the sensor model, shape (p,)."""
        return np.array([self.parameters[n].value for n in self.sensors.names])


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


def make_result(judged: Judged, run: RigRun | NavRun) -> RigResult:
    """Make the result file of a calibration."""
    found = judged.found
    site = run.facts.site
    result = RigResult(
        software=f"accelbench {version('accelbench')}",
        mode=found.mode,
        groups=_groups(found.sensors),
        steps=judged.steps,
        t_ref_c=found.sensors.t_ref_c,
        gravity_m_s2=found.sensors.gravity_m_s2,
        parameters=_parameters(found),
        names=found.names,
        covariance=tuple(tuple(row) for row in found.cov.tolist()),
        prior=_priors(found),
        noise=_noise(found),
        run=RunFacts(
            source=Path(run.source).name,
            digest=run_digest(run),
            rows=len(run),
            cycles=len(run.cycles),
            latitude_deg=float(np.rad2deg(site.lat_rad)),
            height_m=site.height_m,
        ),
        iterations=found.iterations if isinstance(found, RigCalibration) else None,
        converged=judged.consistency.converged,
        north=_north(found),
        consistency=consistency_document(judged.consistency),
        observability=observability_document(judged.observability),
        refused=_refused(judged),
        warnings=judged.warnings,
    )
    return result.model_copy(update={"result_id": result_digest(result)})


def result_digest(result: RigResult) -> str:
    """Return the digest of a result's content."""
    content = result.model_dump(mode="json", exclude={"result_id"})
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def dump_result(result: RigResult) -> str:
    """Return the text of RESULT.json."""
    return json.dumps(result.model_dump(mode="json"), ensure_ascii=False, indent=1) + "\n"


def read_result(path: Path | str) -> RigResult:
    """Read RESULT.json.

    Raises
    ------
    InputError
        If it cannot be read, a key is wrong, or it was changed by hand.
    """
    try:
        data = json.loads(read_text(path))
    except (ValueError, RecursionError) as err:
        raise InputError(path, "", f"not JSON: {err}") from None
    result = check(data, RigResult, path)
    if result_digest(result) != result.result_id:
        raise InputError(path, "result_id", "does not fit the content: the file was changed")
    return result


def _groups(sensors: SensorModel) -> tuple[str, ...]:
    """Return a model's groups in an order that gives its names' order again.

    Accelerometer x has no misalignment: what is added after the basic groups would come before it.
    """
    there = dict.fromkeys(group_of(n) for n in sensors.names)
    return tuple(dict.fromkeys([*(g for g in BASIC if g in there), *there]))


def _parameters(found: Calibration) -> dict[str, ParameterValue]:
    units = found.sensors.units
    rows = zip(found.names, found.values.tolist(), found.sigmas.tolist(), strict=True)
    return {n: ParameterValue(value=v, sigma=s, unit=units.get(n, "rad")) for n, v, s in rows}


def _priors(found: Calibration) -> dict[str, PriorValue]:
    sigma = np.sqrt(np.diag(found.prior.cov)).tolist()
    out = {
        n: PriorValue(mean=m, sigma=s)
        for n, m, s in zip(found.sensors.names, found.prior.values.tolist(), sigma, strict=True)
    }
    mounts = [n for n in found.names if n.startswith(MOUNT)]
    mount = found.prior.mount_sigma_rad
    return out | {n: PriorValue(mean=0.0, sigma=mount) for n in mounts}


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
    held = c.held_out
    return {
        **_nis(c.nis),
        "passed": c.passed,
        "tests": {
            "converged": c.converged,
            "nis": c.nis.passed if c.noise_known else None,
            "white": c.white,
            "no_slow_drift": c.steady,
            "within_bound": c.within_bound if c.bounded else None,
            "held_out": c.repeats if held else None,
            "prior": c.expected,
        },
        "channels": {
            one.name: {**_nis(one.nis), "white_p": one.white_p, "slow_drift_p": one.slow_p}
            for one in c.channels
        },
        "bounded": _nis(c.bounded) if c.bounded else None,
        "prior": _shift(c.prior),
        "held_out": None
        if held is None
        else {
            "cycle": held.cycle + 1,
            **_shift(held.shift),
            "force_residual_before_m_s2": held.before_m_s2,
            "force_residual_after_m_s2": held.after_m_s2,
        },
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
