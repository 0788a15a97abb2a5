"""Questions of unusual length, by which an RTU reply is known to belong to its question."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Address = Annotated[int, Field(ge=0, le=0xFFFF)]


class Barrier(BaseModel):
    """Registers that are always readable, to be asked for in unusual numbers.

    An RTU reply does not say to which question it belongs. A reply of a length that no other
    question has tells that everything asked before has been dealt with.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    address: Address
    counts: tuple[int, int] = (3, 4)
