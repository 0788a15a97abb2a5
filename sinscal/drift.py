"""Slow drift of the constant errors: its family by likelihood, and into the model with it.

A walk enters the filter as noise of the motion, so that every sigma carries it; an even or fading
course enters as a term of three unknowns beside the constant error.
"""

from dataclasses import dataclass, replace

import numpy as np

from sinscal.effect_tests import EffectTest, EffectTests
from sinscal.effect_views import DRIFT_SIGMAS, RAMP, WALK
from sinscal.rig_effects import BY_NAME
from sinscal.rig_model_file import BiasDrift
from sinscal.rigdata import RigNoise
from sinscal.terms import Kind

WORDS = {"walk": "a random walk", "ramp": "an even drift", "warm_up": "a drift that fades"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """A drift that a run shows.

    Attributes
    ----------
    kind : {"gyro", "accel"}
    family : {"walk", "ramp", "warm_up"}
    sigma : float
        About how large it is: of a walk its sigma about the mean, else the change over the run;
        rad/s or m/s².
    tau_s : float
        Of a walk its correlation time, of a warm-up its time constant, of a ramp the run's length.
    span_s : float
        The run's length.
    """

    kind: Kind
    family: str
    sigma: float
    tau_s: float
    span_s: float

    @property
    def term(self) -> BiasDrift | None:
        """The term that it is in the sensors' model; None for a walk."""
        if self.family == "walk" or self.kind == "angle":
            return None
        tau_s = None if self.family == "ramp" else self.tau_s
        return BiasDrift(kind=self.kind, tau_s=tau_s, span_s=self.span_s)

    def allowed_for(self, noise: RigNoise) -> RigNoise:
        """Return noise that has the drift; that of another kind stays, at the longer time."""
        if self.family != "walk":
            return noise
        if self.kind == "gyro":
            noise = replace(noise, gyro_instability=self.sigma)
        else:
            noise = replace(noise, accel_instability=self.sigma)
        return replace(noise, instability_tau_s=self.tau_s)

    @property
    def sentence(self) -> str:
        """What drifts, and how."""
        unit = "rad/s" if self.kind == "gyro" else "m/s²"
        sensors = "gyros" if self.kind == "gyro" else "accelerometers"
        return (
            f"the constant errors of the {sensors} drift slowly; {WORDS[self.family]} of about "
            f"{self.sigma:.2g} {unit} over {self.tau_s:.0f} s is the most probable course"
        )

    @property
    def warning(self) -> str:
        """What a calibration says of it."""
        return f"drift_estimated: {self.sentence}; it is estimated, and the sigmas carry it"


def drift_shown(effects: EffectTests, span_s: float) -> Drift | None:
    """Return the drift that explains best what the innovations show; None if it is something else.

    Parameters
    ----------
    effects : EffectTests
        Of a calibration without it.
    span_s : float
        Length of the run.
    """
    if not effects.missing:
        return None
    best = effects.missing[0]
    return drift_of(best, span_s)


def drift_of(test: EffectTest, span_s: float) -> Drift | None:
    """Return the drift that a test speaks of."""
    kind = BY_NAME[test.name].drift
    if kind is None:
        return None
    sigma = test.scale * DRIFT_SIGMAS[kind]
    if test.theta == WALK:
        # waves of cos(kπt/T) with sigmas s/k are a walk of s·π/√(2T) per √s; its sigma about the
        # mean is that of a process with the correlation time T whose rate is the same
        return Drift(
            kind=kind, family="walk", sigma=sigma * np.pi / 2.0, tau_s=span_s, span_s=span_s
        )
    (share,) = test.theta
    family = "ramp" if share == RAMP else "warm_up"
    tau_s = span_s if share == RAMP else share * span_s
    return Drift(kind=kind, family=family, sigma=sigma, tau_s=tau_s, span_s=span_s)
