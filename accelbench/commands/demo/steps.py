"""The steps of a demonstration told as they begin, with about how long the rest will take."""

import time
from collections.abc import Callable, Sequence

from thermo.planning.text import duration_text


class DemoSteps:
    """Tells what is being done.

    Parameters
    ----------
    tell : callable
        Takes a line.
    weights : sequence of float
        How long the steps take beside each other, in any unit.
    """

    def __init__(self, tell: Callable[[str], None], weights: Sequence[float]) -> None:
        self.tell = tell
        self._weights = list(weights)
        self._began_s, self._step = time.monotonic(), 0

    def add(self, weight: float) -> None:
        """Put a step that nobody expected next."""
        self._weights.insert(self._step, weight)

    def next(self, text: str) -> None:
        """Begin the next step."""
        done, left = sum(self._weights[: self._step]), sum(self._weights[self._step :])
        self._step += 1
        more = ""
        if done:
            spent_s = time.monotonic() - self._began_s
            more = f"; about {duration_text(spent_s * left / done)} left"
        self.tell(f"{self._step} of {len(self._weights)}: {text}{more}")
