"""Unit and scale of an output."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

OutputUnit: TypeAlias = Literal["mA", "V", "m/s2", "g", "count"]


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputScale:
    """Unit and scale of an output: `nominal_scale` is `output_unit` per g.

    `temp_sigma_c` and `temp_gain_ppm` are what its thermistor may be wrong by, 1 sigma: an offset,
    and a gain about 0 °C.
    """

    output_unit: OutputUnit
    gravity_m_s2: float
    nominal_scale: float
    temp_sigma_c: float = 0.0
    temp_gain_ppm: float = 0.0
