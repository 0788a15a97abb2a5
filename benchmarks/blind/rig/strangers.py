"""What may be wrong with a rig run that is in nobody's library."""

from collections.abc import Callable

import numpy as np

from benchmarks.blind.rig.motion import Floats, Motion
from benchmarks.blind.rig.truth import Stranger

TURNS = 3  # periods in a turn of what shakes with the rotation
WAVE_C = 6.0
WALK_STEP_S = 5.0


def _force(shape: Callable[[Motion, Floats, Floats], Floats], direction: Floats) -> Stranger:
    """Return a stranger that adds a shape (n,) times a direction to the accelerometers."""

    def stranger(motion: Motion, t: Floats, x: Floats) -> tuple[Floats, Floats]:
        force = shape(motion, t, x)[:, None] * direction
        return np.zeros_like(force), force

    return stranger


def shaking(rng: np.random.Generator) -> Stranger:
    """Return a vibration of the platform, three times a turn."""
    phase = 2 * np.pi * rng.random()
    direction = _direction(rng)

    def shape(motion: Motion, t: Floats, x: Floats) -> Floats:
        del t, x
        return np.sin(TURNS * 0.5 * (motion.angle[1:] + motion.angle[:-1]) + phase)

    return _force(shape, direction)


def temperature_wave(rng: np.random.Generator) -> Stranger:
    """Return an error of the accelerometers that is periodic in temperature."""
    phase = 2 * np.pi * rng.random()
    return _force(lambda m, t, x: np.sin(2 * np.pi * x[:, 0] / WAVE_C + phase), _direction(rng))


def slow_walk(rng: np.random.Generator) -> Stranger:
    """Return a random walk of the accelerometers' biases, through rests as well; rms one."""
    at = WALK_STEP_S * np.arange(2000)
    walk = np.cumsum(rng.standard_normal((at.size, 3)), axis=0) * np.sqrt(WALK_STEP_S / 500.0)

    def stranger(motion: Motion, t: Floats, x: Floats) -> tuple[Floats, Floats]:
        del motion, x
        force = np.column_stack([np.interp(t, at, w) for w in walk.T])
        return np.zeros_like(force), force

    return stranger


def _direction(rng: np.random.Generator) -> Floats:
    drawn = rng.standard_normal(3)
    return drawn / np.linalg.norm(drawn)


STRANGERS: dict[str, Callable[[np.random.Generator], Stranger]] = {
    "phase_vibration": shaking,
    "periodic_in_temperature": temperature_wave,
    "slow_wander": slow_walk,
}
