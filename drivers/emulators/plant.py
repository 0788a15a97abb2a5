"""Protocol of the physics that emulated instruments ask; the physics is passed in from above."""

from typing import Protocol


class Plant(Protocol):
    """Chamber, head and accelerometers as physical things in one emulated time.

    Times are seconds of the emulation's clock. Commands and states (temperature, angle, moving)
    are given with the present; `channel_value` is also asked for moments still to come, at most
    the length of a scan ahead, since an emulated scan is computed at once. So the time of a call
    may lie a little before that of the call before it; a plant must answer that too, and may do so
    with what it already computed. Thread-safe: three emulated instruments ask it at once.
    """

    def drive_chamber(
        self, now_s: float, start_c: float, target_c: float, rate_c_per_s: float
    ) -> None:
        """From `now_s` the controller's set point goes from `start_c` to `target_c` uniformly.

        `rate_c_per_s` may be inf (a step). The air follows with the chamber's own dynamics.
        """
        ...

    def break_away(self, now_s: float, rate_c_per_s: float | None) -> None:
        """Let the heater run away at a rate, whatever the set point; None: back to normal."""
        ...

    def air_temp_c(self, now_s: float) -> float:
        """Temperature at the controller's sensor, °C."""
        ...

    def turn_head(self, now_s: float, target_deg: float, speed_deg_per_s: float) -> None:
        """Start turning the head to an angle."""
        ...

    def stop_head(self, now_s: float) -> None:
        """Stop the head where it is."""
        ...

    def head_deg(self, now_s: float) -> float:
        """Angle by the head's encoder, ° (the true angle differs by the head's error)."""
        ...

    def head_is_moving(self, now_s: float) -> bool:
        """Tell whether the head turns."""
        ...

    def channel_value(self, now_s: float, channel: int) -> float:
        """Return what the digitiser measures on a channel: V or ohm, meter noise included."""
        ...
