"""Slow drift of the constant errors: its family by likelihood, and into the model with it.

A walk enters the filter as noise of the motion, so that every sigma carries it; an even or fading
course enters as a term of three unknowns beside the constant error. Where one kind of sensor walks,
the other is allowed a walk too, as large as the run leaves it likely: beside the larger one it
would not show.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinscal.calibration.effect_tests import EffectTest, EffectTests
from sinscal.filter.data import RigNoise
from sinscal.frames.earth import DEG_PER_H
from sinscal.library import rig_library
from sinscal.library.groups import Kind
from sinscal.library.jump import DRIFT_SIGMAS
from sinscal.model.larger_model import BiasDrift
from sinscal.sensitivity.problem import FilterProblem
from sinscal.sensitivity.views import RAMP, WALK
from sinscal.sensitivity.walks import likely_walks

WORDS = {"walk": "a random walk", "ramp": "an even drift", "warm_up": "a drift that fades"}
# the unit of --gyro-instability and the like, how many SI units that is, and the sensors
_OF_KIND: Mapping[Kind, tuple[str, float, str]] = {
    "gyro": ("°/h", DEG_PER_H, "gyros"),
    "accel": ("m/s²", 1.0, "accelerometers"),
}


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
    shown : bool
        Whether a test showed it; False of a walk that is only allowed for beside another.
    """

    kind: Kind
    family: str
    sigma: float
    tau_s: float
    span_s: float
    shown: bool = True

    @property
    def term(self) -> BiasDrift | None:
        """The term that it is in the sensors' model; None for a walk."""
        if self.family == "walk" or self.kind == "angle":
            return None
        tau_s = None if self.family == "ramp" else self.tau_s
        return BiasDrift(kind=self.kind, tau_s=tau_s, span_s=self.span_s)

    def allowed_for(self, noise: RigNoise) -> RigNoise:
        """Return noise that has the drift; that of another kind stays."""
        if self.family != "walk":
            return noise
        if self.kind == "gyro":
            noise = replace(noise, gyro_instability=self.sigma)
        else:
            noise = replace(noise, accel_instability=self.sigma)
        return replace(noise, instability_tau_s=self.tau_s)

    @property
    def sentence(self) -> str:
        """Sentence on what drifts, and how."""
        unit, size, sensors = _OF_KIND[self.kind]
        return (
            f"the constant errors of the {sensors} drift slowly; {WORDS[self.family]} of about "
            f"{self.sigma / size:.2g} {unit} over {self.tau_s:.0f} s is the most probable form"
        )

    @property
    def warning(self) -> str:
        """Warning of a calibration about the drift."""
        if self.shown:
            return f"drift_estimated: {self.sentence}; it is estimated and included in the sigmas"
        unit, size, sensors = _OF_KIND[self.kind]
        return (
            f"drift_allowed: beside this drift, a drift of the {sensors} of about "
            f"{self.sigma / size:.2g} {unit} would not be visible; it is included in the sigmas"
        )


def further_drifts(
    effects: EffectTests, problem: FilterProblem, known: Sequence[Drift], variance: float
) -> tuple[Drift, ...]:
    """Return the drift that explains best what the innovations show, and a walk allowed beside it.

    Parameters
    ----------
    effects : EffectTests
        Of a calibration without it.
    problem : FilterProblem
        Of that calibration.
    known : sequence of Drift
        What its model has already.
    variance : float
        Of the normalised innovations, 1 where the noise is as stated.

    Returns
    -------
    tuple of Drift
        None where something else explains it better, or where the model has such a drift.
    """
    span_s = problem.run.length_s
    best = drift_of(effects.missing[0], span_s) if effects.missing else None
    if best is None or any(d.kind == best.kind and d.shown for d in known):
        return ()
    if best.family != "walk":
        return (best,)
    if any(d.family == "walk" for d in known):
        return ()
    walks = likely_walks(problem, variance)
    sigmas: dict[Kind, float] = {"gyro": walks.gyro, "accel": walks.accel}
    found = [
        replace(best, kind=k, sigma=s, tau_s=walks.tau_s, shown=k == best.kind)
        for k, s in sigmas.items()
    ]
    return tuple(sorted(found, key=lambda d: not d.shown))


def drift_of(test: EffectTest, span_s: float) -> Drift | None:
    """Return the drift that a test speaks of."""
    kind = rig_library().by_name[test.name].drift
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
