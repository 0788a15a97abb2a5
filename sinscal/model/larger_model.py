"""The larger rig model as a file: what `discrepancy rig` adds, for the rig filter to take as it is.

TOML. `groups` and `steps` are what the filter is to estimate in addition; `effects` tells what was
found of them, for people: a filter that started from it would use the same data twice.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from errormodel.errors import InputError
from errormodel.io.toml import read_toml
from errormodel.io.toml_write import Plain, toml_text
from sinscal.library import rig_library
from sinscal.library.angle import MOUNT
from sinscal.library.groups import Group, Kind
from sinscal.library.jump import constant_error_drift, constant_error_step
from sinscal.recording.run import NavRun, RigRun

Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class BiasStep(_Part):
    """A jump of the constant errors of the gyros or the accelerometers, s from the run's start."""

    kind: Literal["gyro", "accel"]
    at_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]

    @property
    def group(self) -> Group:
        """The group of its terms."""
        kind: Kind = self.kind
        return constant_error_step(kind, self.at_s)


class BiasDrift(_Part):
    """A drift of the constant errors over a run of `span_s`: even, or fading with `tau_s`."""

    kind: Literal["gyro", "accel"]
    tau_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    span_s: Annotated[float, Field(gt=0, allow_inf_nan=False)]

    @property
    def group(self) -> Group:
        """The group of its terms."""
        kind: Kind = self.kind
        return constant_error_drift(
            kind, math.inf if self.tau_s is None else self.tau_s, self.span_s
        )


class FoundValue(_Part):
    """Estimate of one parameter; SI."""

    value: Finite
    sigma: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    unit: str


class RigModelFile(_Part):
    """MODEL.toml of a rig: what is estimated beside the basic errors.

    Attributes
    ----------
    mode : {"coarse", "precise"}
        Without the rig's angle, or with it.
    t_ref_c : float
        Reference temperature of all terms.
    groups : tuple of str
        Of `sinscal.library`.
    mount : bool
        Whether the mounting on the platform is among them; `rig calibrate` has it in any case.
    steps : tuple of BiasStep
        One of each kind at most.
    effects : dict
        Effect to parameter to what was found.
    """

    mode: Literal["coarse", "precise"] = "coarse"
    t_ref_c: Finite = 25.0
    groups: tuple[str, ...] = ()
    mount: bool = False
    steps: tuple[BiasStep, ...] = ()
    effects: dict[str, dict[str, FoundValue]] = {}

    @model_validator(mode="after")
    def _possible(self) -> "RigModelFile":
        for name in self.groups:
            try:
                rig_library().group(name)
            except KeyError as err:
                raise ValueError(err.args[0]) from None
        if len({s.kind for s in self.steps}) < len(self.steps):
            raise ValueError("expected one step of each kind of sensor at most")
        named = [*self.groups, *self.effects, *([MOUNT] if self.mount else [])]
        angle = [n for n in named if rig_library().needs_angle(n)]
        if self.mode == "coarse" and angle:
            raise ValueError(f"{angle[0]} shows in the rig's angle: expected mode 'precise'")
        return self


def check_needs(groups: Sequence[str], run: RigRun | NavRun, mode: str) -> None:
    """Check that a run and a mode have what groups of terms need to show.

    Raises
    ------
    InputError
        If they do not.
    """
    known = rig_library()
    angle = [g for g in groups if known.needs_angle(g)]
    if angle and mode != "precise":
        raise InputError(run.source, "mode", f"{angle[0]} needs the rig's angle: expected precise")
    warm = [g for g in groups if g in known.groups and known.groups[g].needs_temperature]
    if warm and run.temp_c is None:
        raise InputError(run.source, "temp_c", f"missing; {warm[0]} needs temperatures")


def read_rig_model(path: Path | str) -> RigModelFile:
    """Read MODEL.toml.

    Raises
    ------
    InputError
        If it cannot be read or a key is not what it should be.
    """
    return read_toml(path, RigModelFile)


def rig_model_toml(model: RigModelFile, sentences: Mapping[str, str]) -> str:
    """Return the text of MODEL.toml, each effect under its sentence."""
    data: dict[str, Plain] = {
        "mode": model.mode,
        "t_ref_c": model.t_ref_c,
        "groups": model.groups,
        **({"mount": True} if model.mount else {}),
    }
    if model.steps:
        data["steps"] = [step.model_dump() for step in model.steps]
    if model.effects:
        data["effects"] = {
            name: {n: found.model_dump() for n, found in parameters.items()}
            for name, parameters in model.effects.items()
        }
    return toml_text(data, {("effects", name): sentences[name] for name in model.effects})
