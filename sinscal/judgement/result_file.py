"""The result of a rig calibration as a file: all that is needed to apply, trust and trace it.

JSON. Values are SI in the order of `names`; `result_id` is a digest of the content.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from errormodel.arrays import FloatArray
from errormodel.io.python_file import LibrarySource, check_source, sources_of
from errormodel.io.signed import check_digest, content_digest, json_file_text, read_json
from errormodel.io.toml import check
from errormodel.terms import Description
from sinscal.calibration.observability import GAUGE
from sinscal.judgement.judge import Judged
from sinscal.judgement.result_content import result_content, rig_estimates
from sinscal.library import BASIC, rig_library
from sinscal.library.angle import MOUNTED
from sinscal.model.larger_model import BiasDrift, BiasStep
from sinscal.model.sensors import SensorModel, sensor_model
from sinscal.recording.run import NavRun, RigRun

FORMAT = "accelbench-rig-calibration"
VERSION = 1
APPLIED = (
    "x = T − t_ref_c; parameters not in names are 0. To correct readings solve for ω and f: "
    "ω ← ω′ − error(ω, f), f ← f′ − error(ω, f), from ω′ and f′, until nothing changes (four times)"
)
REST = "specific force at rest points up; the platform's axes are those of exp(rig_mount ×)·body"
AXES_TEXT = (
    "the accelerometers define the body frame: z is along accelerometer z's sensitive axis, "
    "y lies in the plane of accelerometers y and z (Γ is lower triangular); right-handed; "
    "east-north-up outside"
)
UNITS = "SI: rad, rad/s, m/s², m, s; scale errors are ratios, misalignments rad"

Finite = Annotated[float, Field(allow_inf_nan=False)]
Sigma = Annotated[float, Field(ge=0, allow_inf_nan=False)]


def calibration_formula() -> str:
    """Return how the library's errors enter what the sensors measure, in words."""
    known = rig_library()
    return (
        f"measured = true + error: ω′ = {known.equation('gyro')}, "
        f"f′ = {known.equation('accel')}, {APPLIED}"
    )


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ParameterEstimate(_Part):
    """One estimate."""

    value: Finite
    sigma: Sigma
    unit: str


class PriorValue(_Part):
    """Prior of a parameter."""

    mean: Finite
    sigma: Sigma


class LibraryFile(_Part):
    """A file of the user's that groups or terms of the model come from."""

    name: str
    sha256: str


class RunFacts(_Part):
    """The run it was made of."""

    source: str
    digest: str
    rows: int
    cycles: int
    latitude_deg: Finite
    height_m: Finite


class ResultContent(_Part):
    """Content that the results of `rig calibrate` and `combine` share: all keys of the former."""

    format: Literal["accelbench-rig-calibration", "accelbench-combined-calibration"] = FORMAT
    format_version: Literal[1] = VERSION
    result_id: str = ""
    software: str
    mode: str
    groups: tuple[str, ...]
    t_ref_c: Finite
    gravity_m_s2: Finite
    parameters: dict[str, ParameterEstimate]
    names: tuple[str, ...]
    covariance: tuple[tuple[Finite, ...], ...]
    prior: dict[str, PriorValue]
    formula: str = Field(default_factory=lambda: calibration_formula())
    signs: str = Field(default_factory=lambda: f"{rig_library().signs}; {REST}")
    axes: str = AXES_TEXT
    units: str = UNITS
    gauge: str = GAUGE
    noise: dict[str, float | None]
    run: RunFacts
    iterations: int
    converged: bool
    north: tuple[dict[str, float], ...] = ()
    consistency: dict[str, Any]
    observability: dict[str, Any]
    refused: dict[str, Any]
    protection: dict[str, Any] | None = None
    drift: tuple[dict[str, Any], ...] = ()
    not_tested: tuple[str, ...] = ()
    library: tuple[LibraryFile, ...] = ()
    warnings: tuple[str, ...]

    @property
    def sensors(self) -> SensorModel:
        """The sensor model the values belong to."""
        raise NotImplementedError

    def described(self, name: str) -> Description:
        """Return what a parameter is."""
        known = rig_library().parameters
        return known[name] if name in known else self.sensors.parameters[name]

    @model_validator(mode="after")
    def _whole(self) -> Self:
        p = len(self.names)
        if tuple(self.parameters) != self.names:
            raise ValueError("names must be those of parameters, in their order")
        if len(self.covariance) != p or any(len(row) != p for row in self.covariance):
            raise ValueError(f"covariance must have {p} rows of {p} numbers")
        return self


class RigResult(ResultContent):
    """RESULT.json of `accelbench rig calibrate`."""

    steps: tuple[BiasStep, ...] = ()
    drifts: tuple[BiasDrift, ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.format != FORMAT:
            raise ValueError(f"format must be {FORMAT}")
        for part in self.library:
            check_source(part.name, part.sha256, rig_library().sources)
        try:
            known = self.sensors.names
        except KeyError as err:
            raise ValueError(str(err.args[0])) from None
        own = tuple(n for n in self.names if n not in MOUNTED)
        if own != known:
            raise ValueError("names must be those of groups, in the order of the sensor model")
        return self

    @property
    def sensors(self) -> SensorModel:
        """The sensor model the values belong to."""
        return sensor_model(
            self.groups,
            more=[one.group for one in (*self.steps, *self.drifts)],
            t_ref_c=self.t_ref_c,
            gravity_m_s2=self.gravity_m_s2,
        )

    @property
    def values(self) -> FloatArray:
        """Estimates in the order of the sensor model, shape (p,)."""
        return np.array([self.parameters[n].value for n in self.sensors.names])


R = TypeVar("R", bound=ResultContent)


def make_result(judged: Judged, run: RigRun | NavRun) -> RigResult:
    """Make the result file of a calibration."""
    found = judged.found
    content = result_content(judged, run, rig_estimates(found))
    groups = _groups(found.sensors)
    return signed(
        RigResult(
            groups=groups,
            steps=judged.steps,
            drifts=judged.terms,
            library=library_files(rig_library().sources, groups),
            **content,
        )
    )


def library_files(
    sources: Sequence[LibrarySource], names: Sequence[str]
) -> tuple[LibraryFile, ...]:
    """Return the user's files that some groups or terms come from, as a result has them."""
    found = sources_of(sources, names)
    return tuple(LibraryFile(name=one.name, sha256=one.sha256) for one in found)


def signed(result: R) -> R:
    """Return a result with the digest of its content."""
    return result.model_copy(update={"result_id": result_digest(result)})


def result_digest(result: ResultContent) -> str:
    """Return the digest of a result's content."""
    content = result.model_dump(mode="json", exclude={"result_id"})
    # files made before these were known keep their digest
    for later in ("protection", "drift", "drifts", "not_tested", "library"):
        if not content.get(later):
            content.pop(later, None)
    return content_digest(content)


def dump_result(result: ResultContent) -> str:
    """Return the text of RESULT.json."""
    return json_file_text(result, indent=1)


def read_result(path: Path | str) -> RigResult:
    """Read RESULT.json of a rig calibration.

    Raises
    ------
    InputError
        If it cannot be read, a key is wrong, or it was changed by hand.
    """
    return checked_result(read_json(path), RigResult, path)


def checked_result(data: Any, kind: type[R], path: Path | str) -> R:
    """Return what was read as a result of some kind.

    Raises
    ------
    InputError
        If a key is wrong, or it was changed by hand.
    """
    result = check(data, kind, path)
    check_digest(result_digest(result), result.result_id, path, "result_id")
    return result


def _groups(sensors: SensorModel) -> tuple[str, ...]:
    """Return a model's groups in an order that gives its names' order again.

    Accelerometer x has no misalignment: what is added after the basic groups would come before it.
    """
    there = dict.fromkeys(one.family for one in sensors.parameters.values())
    return tuple(dict.fromkeys([*(g for g in BASIC if g in there), *there]))
