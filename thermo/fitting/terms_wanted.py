"""TERMS.toml: what a fit is asked to do in place of what it would choose."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from errormodel.io.toml import read_toml
from errormodel.model import ErrorModel
from thermo.library import term


def check_terms(names: Sequence[str]) -> None:
    """Check that the library in use has every term named.

    Raises
    ------
    ValueError
        If it has not; the message lists the terms.
    """
    for name in names:
        try:
            term(name)
        except KeyError as err:
            raise ValueError(err.args[0]) from None


class TermsFile(BaseModel):
    """TERMS.toml: the terms to fit, in place of those that the data choose.

    `start` holds start values of nonlinear parameters, in their own units; `head_arcsec` is what
    the indexing head's angle may be wrong by, 1 sigma, and goes into the covariance.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    terms: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    t_ref_c: Annotated[float, Field(ge=-200, le=400, allow_inf_nan=False)] = 25.0
    start: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = {}
    head_arcsec: Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)] = 0.0

    @field_validator("terms")
    @classmethod
    def _known(cls, names: tuple[str, ...] | None) -> tuple[str, ...] | None:
        check_terms(names or ())
        if names is not None and len(set(names)) != len(names):
            raise ValueError("a term is listed twice")
        return names

    @model_validator(mode="after")
    def _start_is_of_the_model(self) -> "TermsFile":
        model = self.model()
        known = {p.name: p for p in model.parameters} if model else {}
        for name, value in self.start.items():
            if name not in known:
                raise ValueError(f"start: {name!r} is not a nonlinear parameter of the terms")
            if not known[name].lo <= value <= known[name].hi:
                lo, hi = known[name].lo, known[name].hi
                raise ValueError(f"start: {name} must be between {lo:g} and {hi:g}")
        return self

    def model(self) -> ErrorModel | None:
        """Return the model of the terms named; None when the data are to choose."""
        return None if self.terms is None else ErrorModel(tuple(term(n) for n in self.terms))


def read_terms(path: Path | str) -> TermsFile:
    """Read TERMS.toml.

    Raises
    ------
    InputError
        If it cannot be read or names an unknown term.
    """
    return read_toml(path, TermsFile)
