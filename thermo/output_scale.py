"""What an output is measured in."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

OutputUnit: TypeAlias = Literal["mA", "V", "m/s2", "g", "count"]


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputScale:
    """What an output is measured in: `nominal_scale` is `output_unit` per g."""

    output_unit: OutputUnit
    gravity_m_s2: float
    nominal_scale: float
