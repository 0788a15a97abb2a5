"""A combined calibration told: the content of its file, as JSON, and in words."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from sinscal.combine import Combination
from sinscal.combined import ChamberModel
from sinscal.judged import Judged
from sinscal.resultfile import (
    AXES_TEXT,
    SIGNS,
    consistency_document,
    observability_document,
    run_digest,
)
from sinscal.run import AXES, RigRun
from thermo.modelfile import CLIP_RULE, EQUATION

FORMAT = "accelbench-combined-calibration"
FORMULA = (
    "gyros: ω′ = ω + error as in signs; accelerometer a: f′ = (1 + accel_scale_a)·s(x)·"
    "(f + mounting + lever + g·(K0(x) + K2·(f/g)² + …)), terms as in equation with a_i = f/g and "
    "k1₀ = 1 + accel_scale_a, k0 = accel_bias_a/(g·k1₀), all other coefficients by axis (k0_t1_a); "
    "x = T_a − t_ref_c; to correct, solve for ω and f"
)


def combined_document(
    made: Combination, judged: Judged, run: RigRun, chambers: Sequence[ChamberModel]
) -> dict[str, Any]:
    """Return the content of RESULT.json: the keys of `rig calibrate` and what combining adds.

    Values and covariance are in the units that stand beside each parameter: SI for the SINS's,
    the chamber's reported ones for its coefficients over temperature.
    """
    found, site = made.calibration, run.facts.site
    factors = _reporting(made)
    scale = np.array([factors.get(n, ("", 1.0))[1] for n in made.names])
    values, cov = made.values * scale, made.cov * np.outer(scale, scale)
    units = {**_units(made), **{n: u for n, (u, _) in factors.items()}}
    sigmas = np.sqrt(np.diag(cov))
    document: dict[str, Any] = {
        "format": FORMAT,
        "format_version": 1,
        "software": f"accelbench {version('accelbench')}",
        "mode": found.mode,
        "t_ref_c": found.sensors.t_ref_c,
        "gravity_m_s2": found.sensors.gravity_m_s2,
        "accelerometers": {
            axis: {
                "serial": one.serial,
                "terms": [t.name for t in one.without_mounting().model.terms],
                "valid_c": list(one.valid_c),
            }
            for axis, one in zip(AXES, chambers, strict=True)
        },
        "parameters": {
            n: {"value": float(v), "sigma": float(s), "unit": units[n]}
            for n, v, s in zip(made.names, values, sigmas, strict=True)
        },
        "names": list(made.names),
        "covariance": cov.tolist(),
        "formula": FORMULA,
        "equation": EQUATION,
        "clip_rule": CLIP_RULE,
        "signs": SIGNS,
        "axes": AXES_TEXT,
        "run": {
            "source": Path(run.source).name,
            "digest": run_digest(run),
            "rows": len(run),
            "cycles": len(run.cycles),
            "latitude_deg": float(np.rad2deg(site.lat_rad)),
            "height_m": site.height_m,
        },
        "iterations": found.iterations,
        "converged": found.converged,
        "consistency": consistency_document(judged.consistency),
        "observability": observability_document(judged.observability),
        "warnings": list(judged.warnings),
        "prior_pull": dict(made.prior_pull),
        "prior_kept": dict(made.prior_kept),
        "chamber_test": {
            "chi2": made.test.chi2, "dof": made.test.dof, "p_value": made.test.p_value
        },
        "contradictions": list(made.test.contradictions),
        "flight_m": dict(made.flight_m),
    }  # fmt: skip
    digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]
    return {"result_id": digest, **document}


def _reporting(made: Combination) -> dict[str, tuple[str, float]]:
    """Return unit and factor of what is reported in other units than the model's own."""
    return {
        u.name: (u.unit, u.per_unit)
        for channel in made.calibration.sensors.channels
        for u in (*channel.model.coefficients, *channel.model.parameters)
        if u.name in made.prior_pull and u.name in made.names
    }


def _units(made: Combination) -> Mapping[str, str]:
    own = made.calibration.sensors.units
    at_ref = {f"accel_bias_{a}": "m/s²" for a in AXES} | {f"accel_scale_{a}": "1" for a in AXES}
    return {n: at_ref.get(n) or own.get(n, "rad") for n in made.names}


def combined_text(document: Mapping[str, Any]) -> Iterator[str]:
    """Tell a combined calibration in words."""
    for name, one in document["parameters"].items():
        pull = document["prior_pull"].get(name)
        moved = "" if pull is None else f"  (moved by {pull:+.2f} of the chamber's sigmas)"
        yield f"{name}: {one['value']:.6g} ± {one['sigma']:.2g} {one['unit']}{moved}"
    test, flight = document["chamber_test"], document["flight_m"]
    yield (
        f"rig against chamber: χ² {test['chi2']:.4g} with {test['dof']} degrees of freedom, "
        f"p {test['p_value']:.2g}"
    )
    yield (
        f"flight error ρ at the end: {flight['no_thermal']:.0f} m without thermal model, "
        f"{flight['before']:.0f} m with it applied beforehand, {flight['combined']:.0f} m combined"
    )
    for line in document["contradictions"]:
        yield f"contradiction: {line}"
    if not document["converged"]:
        yield "not converged: the values are not to be used"
    for warning in document["warnings"]:
        yield f"warning: {warning}"
