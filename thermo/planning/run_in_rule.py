"""The section [run_in] of a sequence: repeat the run as a cycle until the accelerometers settle."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, Strict, model_validator

MAX_CYCLES = 100  # the inference takes memory with the square of it

Limit = Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
Cycles = Annotated[int, Strict(), Field(ge=3, le=MAX_CYCLES)]


class RunInRule(BaseModel):
    """Rule by which a run-in stops by itself.

    Attributes
    ----------
    k0_limit_ug, k1_limit_ppm : float
        The change of K0 and K1 at `t_ref_c` that is acceptable ever after.
    min_cycles, max_cycles : int
        It does not stop before the first, and stops at the second, settled or not.
    confidence : float
        That an accelerometer declared settled does not change by more than the limits.
    t_ref_c : float
        Temperature at which K0 and K1 are compared, °C.
    nothing_slow : bool
        Assume that nothing slower than the relaxation goes on: the stop comes earlier, and says so.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    k0_limit_ug: Limit
    k1_limit_ppm: Limit
    min_cycles: Cycles = 4
    max_cycles: Cycles = 25
    confidence: Annotated[float, Strict(), Field(ge=0.6, le=0.999)] = 0.95
    t_ref_c: Annotated[float, Strict(), Field(ge=-200, le=400, allow_inf_nan=False)] = 25.0
    nothing_slow: Annotated[bool, Strict()] = False

    @model_validator(mode="after")
    def _check(self) -> "RunInRule":
        if self.min_cycles > self.max_cycles:
            raise ValueError(f"min_cycles {self.min_cycles} is above max_cycles {self.max_cycles}")
        return self
