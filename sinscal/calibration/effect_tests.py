"""Score tests of the effects that a calibration's model lacks, on its own innovations.

Without the effect the innovations over their sigmas are white and of unit variance, so that what
an effect explains of their χ² is χ² with as many degrees of freedom as it shows (Rao's score test,
the same as the Lagrange multiplier's). Of an effect tried in several shapes the best counts, its
p-value times their number; the false-alarm rate is shared evenly by all effects (Bonferroni).

References
----------
Rao, C. R. (1948), Large sample tests of statistical hypotheses concerning several parameters,
Proc. Cambridge Phil. Soc. 44.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from errormodel.discrepancy.problem import Theta

# Of sound runs at most so many fail by any of these tests.
FALSE_ALARM = 5e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectTest:
    """Test for one missing effect.

    Attributes
    ----------
    name : str
    chi2, dof
        Of the most probable shape.
    p_value : float
        Over all shapes tried.
    likelihood : float
        By how much the effect of that shape raises the log likelihood, its size drawn and not
        fitted.
    evidence : float
        The same in the mean over all shapes tried.
    scale : float
        Its size, in sigmas of what is expected.
    theta : tuple of float
        That shape: see `EffectView`.
    sizes : mapping of str to float
        The unknowns as they would be, SI; empty for a drift or where many shapes fit.
    """

    name: str
    chi2: float
    dof: int
    p_value: float
    likelihood: float
    evidence: float
    scale: float
    theta: Theta
    sizes: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectTests:
    """The tests of all effects that the model lacks and the run could show.

    The most probable first: by the evidence, which a small p-value alone is not.
    """

    tests: tuple[EffectTest, ...]

    @property
    def least_p(self) -> float:
        """The p-value below which an effect is missing."""
        return FALSE_ALARM / max(len(self.tests), 1)

    @property
    def missing(self) -> tuple[EffectTest, ...]:
        """The effects that the innovations show, each as if it were alone."""
        return tuple(t for t in self.tests if t.p_value < self.least_p)

    @property
    def passed(self) -> bool:
        """True when none is missing."""
        return not self.missing
