"""Laboratory of a report: its name, the operator, the instruments, as the user states them."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from errormodel.io.toml import check, parse_toml, read_text

NOT_GIVEN = "not given"


class Laboratory(BaseModel):
    """The table `[laboratory]` of LAB.toml; what is left out is told as not given.

    Attributes
    ----------
    name, operator : str
    instruments : tuple of str
        With maker, type, serial number and date of calibration, as the report shall say.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(default="", max_length=200)
    operator: str = Field(default="", max_length=200)
    instruments: tuple[str, ...] = Field(default=(), max_length=50)

    def told(self) -> tuple[tuple[str, str], ...]:
        """Return what it is and what was stated, a pair a line of the header."""
        return (
            ("Laboratory", self.name or NOT_GIVEN),
            ("Operator", self.operator or NOT_GIVEN),
            ("Instruments", "; ".join(self.instruments) or NOT_GIVEN),
        )


class _LabFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    laboratory: Laboratory


def read_laboratory(path: Path) -> Laboratory:
    """Read LAB.toml.

    Raises
    ------
    InputError
        If it cannot be read, is not TOML, or has another key.
    """
    return check(parse_toml(read_text(path), path), _LabFile, path).laboratory
