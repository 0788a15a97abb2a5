"""Register maps of chamber controllers as data: one TOML file a model.

A map says where a value lives, how its bits are laid out and scaled, and what its enumerated
values are called. Drivers name registers; addresses and scales stand nowhere else. Where a
controller can be set to send 32 bits either way round, the map says `word_order = "station"`: the
station file knows.
"""

import math
import struct
import tomllib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from drivers.links.barrier import Address, Barrier

WordOrder = Literal["low", "high"]
_FORMATS = {"int16": ">h", "uint16": ">H", "int32": ">i", "uint32": ">I", "float32": ">f"}


class Register(BaseModel):
    """One value in a controller's register space.

    `scale` is how many units of the wire make one of the value ("decimals": 10 to the controller's
    number of decimals). `resolution` is how far a value read back may lie from the one written;
    left out, it is half a unit of the wire.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    address: Address
    kind: Literal["int16", "uint16", "int32", "uint32", "float32"] = "int16"
    word_order: WordOrder = "high"  # which 16 bits of a 32-bit value come first
    scale: Annotated[float, Field(gt=0)] | Literal["decimals"] = 1.0
    access: Literal["r", "w", "rw"] = "r"
    values: dict[str, int] = {}
    optional: bool = False  # not every build of the controller has it
    setting: bool = False  # worth keeping with a run
    watched: bool = False  # what was commanded there is compared with what it holds, over and over
    resolution: Annotated[float, Field(gt=0)] | None = None

    @property
    def count(self) -> int:
        """Number of 16-bit registers it takes."""
        return 1 if self.kind in ("int16", "uint16") else 2

    def factor(self, decimals: int) -> float:
        """Return the units of the wire that make one of the value."""
        return 10.0**decimals if self.scale == "decimals" else self.scale

    def tolerance(self, decimals: int) -> float:
        """Return how far a value read back may lie from the one written."""
        if self.resolution is not None:
            return self.resolution
        # half a unit was lost by rounding; the rest is room for the division's own rounding
        return 0.5 / self.factor(decimals) * (1 + 1e-6)

    def encode(self, value: float, decimals: int = 0) -> tuple[int, ...]:
        """Turn a value into the registers that carry it.

        Parameters
        ----------
        value : float
            In the register's unit.
        decimals : int
            The controller's number of decimals.

        Returns
        -------
        tuple of int, length `count`
            16-bit words in the order of their addresses.

        Raises
        ------
        ValueError
            If the value is not finite or the register cannot hold it.
        """
        scaled = value * self.factor(decimals)
        if not math.isfinite(scaled):
            raise ValueError(f"{value} is no value for a register")
        try:
            whole = scaled if self.kind == "float32" else round(scaled)
            raw = struct.pack(_FORMATS[self.kind], whole)
        except (struct.error, OverflowError):
            raise ValueError(f"{value:g} does not fit {self.kind} at {self.address}") from None
        words = struct.unpack(f">{self.count}H", raw)
        return words[::-1] if self.word_order == "low" else words

    def decode(self, words: Sequence[int], decimals: int = 0) -> float:
        """Turn registers into the value they carry; the inverse of `encode`.

        Parameters
        ----------
        words : sequence of int, length `count`
        decimals : int
            The controller's number of decimals.

        Returns
        -------
        float
            In the register's unit; a float32 may be nan or infinite.

        Raises
        ------
        ValueError
            If the number of words is not `count`.
        """
        if len(words) != self.count:
            raise ValueError(f"{self.kind} takes {self.count} registers, got {len(words)}")
        ordered = words[::-1] if self.word_order == "low" else words
        raw = struct.pack(f">{self.count}H", *ordered)
        number = float(struct.unpack(_FORMATS[self.kind], raw)[0])
        return number / self.factor(decimals)

    def name_of(self, value: float) -> str:
        """Return what an enumerated value is called, or the number itself."""
        return next((n for n, v in self.values.items() if v == value), f"code {value:g}")


class RegisterMap(BaseModel):
    """All that is known of one controller model."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    title: str
    ramp_rate_step_c_per_min: Annotated[float, Field(gt=0)] | None = None
    ramp_rate_max_c_per_min: Annotated[float, Field(gt=0)]
    barrier: Barrier
    registers: dict[str, Register]

    def __getitem__(self, name: str) -> Register:
        return self.registers[name]


@cache
def load_map(model: str, word_order: WordOrder = "low") -> RegisterMap:
    """Read the register map of a model that this package ships.

    Parameters
    ----------
    model : str
        As the station file writes it, for example "watlow_f4t".
    word_order : "low" or "high"
        For the registers whose word order the map leaves to the station file.

    Returns
    -------
    RegisterMap

    Raises
    ------
    ValueError
        If there is no map of that name.
    """
    source = files(__name__) / f"{model}.toml"
    if not source.is_file():
        raise ValueError(f"no register map for the controller {model!r}")
    read = tomllib.loads(source.read_text(encoding="utf-8"))
    for register in read["registers"].values():
        if register.get("word_order") == "station":
            register["word_order"] = word_order
    return RegisterMap.model_validate(read)
