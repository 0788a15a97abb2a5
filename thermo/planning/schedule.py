"""Readings at equal intervals: absolute deadlines, so that lateness never adds up."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Slot k is due at ``start_s + k·period_s`` on the clock, whatever befell the slots before.

    Raises
    ------
    ValueError
        If the period is not positive and finite.
    """

    start_s: float
    period_s: float

    def __post_init__(self) -> None:
        if not (self.period_s > 0 and math.isfinite(self.period_s)):
            raise ValueError(f"period {self.period_s} s must be positive and finite")

    def deadline_s(self, slot: int) -> float:
        """Return when a slot is due, s on the clock."""
        return self.start_s + slot * self.period_s

    def first_open(self, slot: int, now_s: float) -> int:
        """Return the first slot from `slot` on that is not yet missed wholly.

        A slot is missed when it is later than a full period; it is then left out, so that
        readings never bunch up behind a delay.

        Parameters
        ----------
        slot : int
            The slot wanted next.
        now_s : float
            The present, s on the clock.

        Returns
        -------
        int
            `slot`, or a later one.
        """
        # a hair of tolerance: `now_s` may be a deadline that was waited for, rounded
        oldest = math.ceil((now_s - self.start_s) / self.period_s - 1 - 1e-9)
        return max(slot, oldest)

    def moved(self, by_s: float) -> "Schedule":
        """Return the schedule with every deadline later by `by_s`."""
        return Schedule(start_s=self.start_s + by_s, period_s=self.period_s)
