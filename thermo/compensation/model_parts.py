"""Parts of a model file."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]


class Part(BaseModel):
    """A part of a model file: frozen, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class CoefficientValue(Part):
    """One coefficient as reported."""

    value: Finite
    sigma: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    unit: str


class SupportPart(Part):
    """Region of temperature, rate and force in which there were readings."""

    temp_c: tuple[tuple[Finite, Finite], ...]
    force_g: dict[str, tuple[Finite, Finite]]


class InsidePart(Part):
    """The coefficients at a temperature within the readings."""

    t_ref_c: Finite
    coefficients: dict[str, CoefficientValue]


class UnseenPart(Part):
    """A polynomial order that the readings do not limit: what it may put wrong, 1 sigma."""

    family: Literal["k0", "k1"]
    order: int
    moves: dict[str, Finite]


class LibraryPart(Part):
    """A file of the user's that terms of the model come from."""

    name: str
    sha256: str
