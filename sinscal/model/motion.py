"""Motion that acts on the sensors over the steps of a cycle."""

from dataclasses import dataclass, replace

from errormodel.arrays import FloatArray, IntArray, freeze, readonly
from sinscal.recording.run import rate_derivative


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Motion:
    """Motion that acts on the sensors over n steps of one cycle.

    Attributes
    ----------
    time_s, step_s : ndarray, shape (n,)
        Ends and lengths of the steps, from the start of the cycle.
    w : ndarray, shape (n, 3)
        Mean rate of the body against inertial space, rad/s.
    f : ndarray, shape (n, 3)
        Mean specific force, m/s².
    dw : ndarray, shape (n, 3)
        Mean derivative of the rate, rad/s².
    temp_c : ndarray, shape (n, 3), optional
        Temperatures of the accelerometers; a gyro is taken to be as warm as that of its axis.
    begin_s : float
        When the cycle began, from the start of the run.
    """

    time_s: FloatArray
    step_s: FloatArray
    w: FloatArray
    f: FloatArray
    dw: FloatArray
    temp_c: FloatArray | None = None
    begin_s: float = 0.0

    def __post_init__(self) -> None:
        names = ("time_s", "step_s", "w", "f", "dw")
        freeze(self, **{name: readonly(getattr(self, name)) for name in names})

    def __len__(self) -> int:
        return self.time_s.size

    def take(self, rows: IntArray | slice) -> "Motion":
        """Return some of the steps, each as it was."""
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in ("time_s", "step_s", "w", "f", "dw")},
            temp_c=None if self.temp_c is None else self.temp_c[rows],
        )


def moved_to(motion: Motion, rows: FloatArray) -> Motion:
    """Return a motion with other rates and forces, shape (6, n)."""
    w = rows[:3].T
    return replace(motion, w=w, f=rows[3:].T, dw=rate_derivative(w, motion.step_s))
