"""The file that `combine` writes: a rig calibration joined with its accelerometers' models.

It has every key of a rig calibration's result, the accelerometers' terms, and what combining them
said. `rig compensate` takes it: it is the compensation file for flight.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, Self, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from errormodel.arrays import FloatArray
from errormodel.io.python_file import LibrarySource, check_source
from errormodel.io.signed import read_json
from errormodel.model import ErrorModel
from sinscal.calibration.observability import observability
from sinscal.combination.combine import Combination
from sinscal.judgement.judge import Judged
from sinscal.judgement.result_content import Estimates, result_content
from sinscal.judgement.result_file import (
    Finite,
    ResultContent,
    RigResult,
    checked_result,
    library_files,
    signed,
)
from sinscal.library import rig_library
from sinscal.library.angle import MOUNTED
from sinscal.model.chamber import (
    ChamberModel,
    at_reference,
    chamber_names,
    combined_sensors,
    from_reference,
)
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import AXES, RigRun
from sinscal.twin.rehearse import Rehearsal
from thermo.compensation.model_file import EQUATION, reporting_factors
from thermo.fitting.terms_wanted import check_terms
from thermo.library import term, thermal_library

FORMAT = "accelbench-combined-calibration"
APPLIED = (
    "accelerometer a: f′ = (1 + accel_scale_a)·s(x)·"
    "(f + mounting + lever + g·(K0(x) + K2·(f/g)² + …)), terms as in equation with a_i = f/g and "
    "k1₀ = 1 + accel_scale_a, k0 = accel_bias_a/(g·k1₀), all other coefficients by axis (k0_t1_a); "
    "x = T_a − t_ref_c; to correct, solve for ω and f"
)
CLIP_RULE = (
    "outside valid_c an accelerometer's temperature is taken as the nearest end of the range"
)
UNITS = (
    "as beside each parameter: SI for the SINS's, the chamber's reported units for coefficients "
    "over temperature; covariance and prior in the same"
)


AT_REFERENCE = {f"accel_bias_{a}": "m/s²" for a in AXES} | {f"accel_scale_{a}": "1" for a in AXES}


def combined_formula() -> str:
    """Return how the errors enter what gyros and accelerometers measure, in words."""
    return f"gyros: ω′ = {rig_library().equation('gyro')}; {APPLIED}"


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class MountedAccelerometer(_Part):
    """An accelerometer of the SINS: which it is, the terms of its model, where it is valid."""

    serial: str
    terms: tuple[str, ...]
    valid_c: tuple[Finite, Finite]


class ChamberTestResult(_Part):
    """The comparison of rig and chamber."""

    chi2: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    dof: int
    p_value: Annotated[float, Field(ge=0, le=1)]


class FlightErrors(_Part):
    """ρ after an hour of flight, m."""

    no_thermal: Finite
    before: Finite
    combined: Finite


class CombinedResult(ResultContent):
    """RESULT.json of `accelbench combine`."""

    accelerometers: dict[Literal["x", "y", "z"], MountedAccelerometer]
    formula: str = Field(default_factory=lambda: combined_formula())
    equation: str = EQUATION
    clip_rule: str = CLIP_RULE
    units: str = UNITS
    prior_pull: dict[str, Finite]
    prior_kept: dict[str, Finite]
    chamber_test: ChamberTestResult
    contradictions: tuple[str, ...]
    flight_m: FlightErrors

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.format != FORMAT:
            raise ValueError(f"format must be {FORMAT}")
        if tuple(self.accelerometers) != AXES:
            raise ValueError("accelerometers must be those of x, y and z")
        for part in self.library:
            check_source(part.name, part.sha256, _sources())
        for one in self.accelerometers.values():
            check_terms(one.terms)
        for group in self.groups:
            try:
                rig_library().group(group)
            except KeyError as err:
                raise ValueError(err.args[0]) from None
        sensors = self.sensors
        own = tuple(n for n in self.names if n not in MOUNTED)
        if own != _told_names(sensors):
            raise ValueError("names must be those of groups and terms, in their order")
        return self

    @property
    def sensors(self) -> SensorModel:
        """The sensor model the values belong to."""
        return combined_sensors([self._chamber(a) for a in AXES], self.groups)

    def _chamber(self, axis: str) -> ChamberModel:
        one = self.accelerometers[cast(Literal["x", "y", "z"], axis)]
        model = ErrorModel(tuple(term(n) for n in one.terms))
        return ChamberModel(
            serial=one.serial,
            model=model,
            values=np.zeros(len(model.names)),
            cov=np.zeros((len(model.names),) * 2),
            gravity_m_s2=self.gravity_m_s2,
            t_ref_c=self.t_ref_c,
            valid_c=one.valid_c,
        )

    @property
    def values(self) -> FloatArray:
        """Estimates in the order of the sensor model, in its own units, shape (p,)."""
        sensors = self.sensors
        factors = reported_factors(sensors)
        own = {n: one.value / factors.get(n, 1.0) for n, one in self.parameters.items()}
        return from_reference(sensors.names, own, self.gravity_m_s2)

    @property
    def valid_c(self) -> tuple[tuple[float, float], ...]:
        """The range of each accelerometer's model, x, y, z."""
        return tuple(one.valid_c for one in self.accelerometers.values())


def _sources() -> list[LibrarySource]:
    return [*rig_library().sources, *thermal_library().sources]


def _told_names(sensors: SensorModel) -> tuple[str, ...]:
    p = len(sensors.names)
    return at_reference(sensors.names, np.zeros(p), np.zeros((p, p)), sensors.gravity_m_s2)[0]


def reported_factors(sensors: SensorModel) -> dict[str, float]:
    """Return what each unknown is multiplied by to be told in the unit that stands beside it.

    At the reference temperature k0 and k1 are told as the SINS's zero and scale errors, in SI.
    """
    out: dict[str, float] = {}
    for channel in sensors.channels:
        out |= reporting_factors(channel.model, 1.0)
    at_ref = {f"{k}_{a}" for k in ("k0", "k1") for a in AXES}
    return {n: f for n, f in out.items() if n not in at_ref}


def combined_estimates(made: Combination) -> Estimates:
    """Return the estimates at the reference temperature as they are told."""
    found, sensors = made.calibration, made.calibration.sensors
    factors = reported_factors(sensors)
    scale = np.array([factors.get(n, 1.0) for n in made.names])
    prior = found.prior
    _, mean, cov = at_reference(sensors.names, prior.values, prior.cov, sensors.gravity_m_s2)
    mounts = len(made.names) - mean.size
    units = sensors.units | AT_REFERENCE
    return Estimates(
        names=made.names,
        values=made.values * scale,
        cov=made.cov * np.outer(scale, scale),
        units={n: units.get(n, "rad") for n in made.names},
        prior_mean=np.append(mean, np.zeros(mounts)) * scale,
        prior_sigma=np.append(np.sqrt(np.diag(cov)), np.full(mounts, prior.mount_sigma_rad))
        * scale,
    )


def told_truth(made: Rehearsal) -> dict[str, dict[str, float | str]]:
    """Return the true errors of a simulated run in the names and units of a calibration."""
    names = tuple(made.values)
    values = np.array([made.values[n] for n in names])
    none = np.zeros((values.size, values.size))
    told, at_ref, _ = at_reference(names, values, none, made.sensors.gravity_m_s2)
    factors, units = reported_factors(made.sensors), {**made.units, **AT_REFERENCE}
    return {
        n: {"value": float(v) * factors.get(n, 1.0), "unit": units[n]}
        for n, v in zip(told, at_ref, strict=True)
    }


def make_combined(
    made: Combination, judged: Judged, run: RigRun, chambers: Sequence[ChamberModel]
) -> CombinedResult:
    """Make the result file of a combined calibration."""
    told = combined_estimates(made)
    shown = observability(told.names, told.cov, told.prior_sigma)
    content = result_content(replace(judged, observability=shown), run, told)
    sensors = made.calibration.sensors
    own = chamber_names(sensors, chambers)
    added = [one.family for name, one in sensors.parameters.items() if name not in own]
    return signed(
        CombinedResult(
            format=FORMAT,
            groups=tuple(dict.fromkeys(added)),
            accelerometers={
                axis: MountedAccelerometer(
                    serial=one.serial,
                    terms=_terms(one),
                    valid_c=one.valid_c,
                )
                for axis, one in zip(("x", "y", "z"), chambers, strict=True)
            },
            prior_pull=dict(made.prior_pull),
            prior_kept=dict(made.prior_kept),
            chamber_test=ChamberTestResult(
                chi2=made.test.chi2, dof=made.test.dof, p_value=made.test.p_value
            ),
            contradictions=made.test.contradictions,
            flight_m=FlightErrors(**made.flight_m),
            library=library_files(_sources(), [*added, *(t for c in chambers for t in _terms(c))]),
            **content,
        )
    )


def _terms(chamber: ChamberModel) -> tuple[str, ...]:
    return tuple(t.name for t in chamber.without_mounting().model.terms)


def read_calibration(path: Path | str) -> RigResult | CombinedResult:
    """Read RESULT.json of `rig calibrate` or of `combine`.

    Raises
    ------
    InputError
        If it cannot be read, a key is wrong, or it was changed by hand.
    """
    data = read_json(path)
    combined = isinstance(data, dict) and cast(dict[str, object], data).get("format") == FORMAT
    return checked_result(data, CombinedResult if combined else RigResult, path)
