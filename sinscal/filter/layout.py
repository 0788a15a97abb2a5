"""The states of the rig filter, by name: what moves, what is started anew, what is constant."""

from dataclasses import dataclass
from functools import cached_property

ENU = ("e", "n", "u")
XYZ = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class RigLayout:
    """States of the filter and their positions.

    Attributes
    ----------
    cycles : int
    parameters : tuple of str
        Unknowns of the sensor model.
    drift : bool
        Whether slow drifts of gyros and accelerometers move beside the attitude.
    counted : bool
        Whether the accelerometers' increments are counted: what was left over at the start and at
        the end of an interval moves beside the attitude.
    wander : bool
        Whether north is unknown: the horizontal parts of the earth's rotation are then unknowns of
        each cycle, in local axes of any azimuth, and the attitude needs none.
    angle : bool
        Whether the rig's angle is used: then the platform's attitude at angle zero (of each cycle)
        and the mounting are unknowns.
    remount : bool
        Whether the mounting differs from cycle to cycle (also: axes that are not orthogonal).
    integrals : tuple of str
        What moves beside the attitude because it is integrated: outputs of a navigator.
    """

    cycles: int
    parameters: tuple[str, ...]
    drift: bool = False
    counted: bool = False
    wander: bool = False
    angle: bool = False
    remount: bool = False
    integrals: tuple[str, ...] = ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all states, the moving ones first."""
        numbers = range(1, self.cycles + 1)
        moving = [f"attitude_{a}" for a in ENU]
        if self.drift:
            moving += [f"{kind}_drift_{a}" for kind in ("gyro", "accel") for a in XYZ]
        if self.counted:
            moving += [f"accel_left_over_{when}_{a}" for when in ("before", "after") for a in XYZ]
        moving += self.integrals
        constant = [f"start_{k}_{a}" for k in numbers for a in ENU]
        if self.wander:
            constant += [f"earth_rate_{k}_{a}" for k in numbers for a in ENU[:2]]
        if self.angle:
            constant += [f"rig_base_{k}_{a}" for k in numbers for a in ENU]
            constant += [f"rig_mount_{a}" for a in XYZ]
        if self.angle and self.remount:
            constant += [f"rig_remount_{k}_{a}" for k in numbers for a in XYZ]
        return (*moving, *constant, *self.parameters)

    @property
    def moving(self) -> int:
        """Number of states that change with time."""
        return 3 + 6 * self.drift + 6 * self.counted + len(self.integrals)

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.names)

    @property
    def left_over(self) -> tuple[slice, slice]:
        """Indices of the counters' remainders before and after an interval."""
        before = self.at("accel_left_over_before_x", 3)
        return before, slice(before.stop, before.stop + 3)

    def at(self, first: str, count: int) -> slice:
        """Return where `count` states begin with the one named."""
        start = self.names.index(first)
        return slice(start, start + count)

    def start(self, k: int) -> slice:
        """Return where the attitude error at the start of cycle k = 0, 1, … stands."""
        return self.at(f"start_{k + 1}_e", 3)

    def earth_rate(self, k: int) -> slice:
        """Return where the error of the earth's horizontal rate stands."""
        return self.at(f"earth_rate_{k + 1}_e", 2)

    def base(self, k: int) -> slice:
        """Return where the error of the platform's attitude at angle zero stands."""
        return self.at(f"rig_base_{k + 1}_e", 3)

    @property
    def mount(self) -> slice:
        """Indices of the mounting."""
        return self.at("rig_mount_x", 3)

    def remounted(self, k: int) -> slice:
        """Return where what cycle k adds to the mounting stands."""
        return self.at(f"rig_remount_{k + 1}_x", 3)

    @property
    def reported(self) -> list[int]:
        """Indices of the reported states: the sensors' parameters, then the mounting."""
        mount = [*range(self.mount.start, self.mount.stop)] if self.angle else []
        return [*range(self.unknowns.start, self.unknowns.stop), *mount]

    @property
    def unknowns(self) -> slice:
        """Indices of the sensor model's parameters."""
        return slice(self.size - len(self.parameters), self.size)
