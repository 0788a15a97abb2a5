"""The snakes on which two calibrations leave the errors that were published for them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import struve

from errormodel.arrays import FloatArray
from sinscal.article.published import COARSE_M, PRECISE_M
from sinscal.flight.covariance import FlightNoise, assess, flight_sensitivity
from sinscal.flight.trajectory import MAX_SWING_RAD, FlightPlan
from sinscal.model.residual_errors import Calibration

SPEEDS_M_S = (80.0, 150.0, 250.0)
SWINGS_RAD = (0.05, 0.15, 0.4, 1.0)
PERIODS_S = (60.0, 120.0, 300.0, 600.0)
SPEED_RANGE_M_S = (20.0, 340.0)
FITS_WITHIN = 0.01  # of both figures, for a snake to belong to the family
REFUSED = 1e3

Targets = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedFlight:
    """A flight tried, and ρ at its end after the coarse and the precise calibration, m."""

    plan: FlightPlan
    coarse_m: float
    precise_m: float
    targets: Targets

    @property
    def miss(self) -> float:
        """The larger of the two relative differences from what was wanted."""
        pairs = zip((self.coarse_m, self.precise_m), self.targets, strict=True)
        return max(abs(got / wanted - 1.0) for got, wanted in pairs)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectorySearch:
    """Result of a search.

    Attributes
    ----------
    scanned : tuple of TriedFlight
        The grid, best first.
    refined : tuple of TriedFlight
        For each period the speed and amplitude that come closest.
    refused : int
        Snakes of the grid that no aircraft flies.
    """

    scanned: tuple[TriedFlight, ...]
    refined: tuple[TriedFlight, ...]
    refused: int

    @property
    def family(self) -> tuple[TriedFlight, ...]:
        """Refined snakes on which both figures come out within 1 %."""
        return tuple(c for c in self.refined if c.miss <= FITS_WITHIN)

    @property
    def best(self) -> TriedFlight:
        """The closest of all."""
        return min((*self.refined, *self.scanned), key=lambda c: c.miss)

    @property
    def ratios(self) -> tuple[float, float]:
        """Smallest and largest ratio of coarse to precise that was met."""
        met = [c.coarse_m / c.precise_m for c in (*self.scanned, *self.refined)]
        return min(met), max(met)


def find_trajectories(
    coarse: Calibration,
    precise: Calibration,
    *,
    base: FlightPlan | None = None,
    noise: FlightNoise | None = None,
    speeds_m_s: Sequence[float] = SPEEDS_M_S,
    swings_rad: Sequence[float] = SWINGS_RAD,
    periods_s: Sequence[float] = PERIODS_S,
    targets: Targets = (COARSE_M, PRECISE_M),
    progress: Callable[[int, int], None] | None = None,
) -> TrajectorySearch:
    """Look for the snakes on which both calibrations leave what was published for them.

    A grid of speeds, swings of the heading and periods is flown; then for each period speed and
    swing are refined (Nelder and Mead, in their logarithms). Two figures against three unknowns:
    where there is a solution there is one for a range of periods.

    Parameters
    ----------
    coarse, precise : Calibration
        Of the same parameters.
    base : FlightPlan, optional
        Heading, duration, place and take-off.
    noise : FlightNoise, optional
    speeds_m_s, swings_rad, periods_s : sequence of float
        The grid; a swing is an amplitude of the heading.
    targets : tuple of float
        What ρ shall be after the coarse and the precise calibration, m.
    progress : callable, optional
        Told how many flights of the grid are done, of how many.

    Raises
    ------
    ValueError
        If the grid holds no flight that can be flown.
    """
    base = base or FlightPlan()

    def fly(plan: FlightPlan | None) -> TriedFlight | None:
        if plan is None:
            return None
        found = flight_sensitivity(plan, coarse.names, noise=noise, every_s=plan.duration_s)
        rho = [assess(found, one).rho_end_m for one in (coarse, precise)]
        return TriedFlight(plan=plan, coarse_m=rho[0], precise_m=rho[1], targets=targets)

    grid = [(v, s, p) for p in periods_s for v in speeds_m_s for s in swings_rad]
    scanned: list[TriedFlight] = []
    for k, (speed, swing, period) in enumerate(grid):
        one = fly(_snake(base, speed, swing, period))
        scanned += [one] if one else []
        if progress is not None:
            progress(k + 1, len(grid))
    if not scanned:
        raise ValueError("none of the flights can be flown: they are too steep")
    scanned.sort(key=lambda c: c.miss)
    refined: list[TriedFlight] = []
    for period in periods_s:
        starts = [c for c in scanned if c.plan.period_s == period]
        refined += [_refined(fly, base, starts[0])] if starts else []
    return TrajectorySearch(
        scanned=tuple(scanned), refined=tuple(refined), refused=len(grid) - len(scanned)
    )


def _snake(base: FlightPlan, speed: float, swing: float, period: float) -> FlightPlan | None:
    if not (SPEED_RANGE_M_S[0] <= speed <= SPEED_RANGE_M_S[1] and swing <= MAX_SWING_RAD):
        return None
    amplitude = speed * period / 4.0 * float(struve(0, swing))
    try:
        return replace(base, speed_m_s=speed, amplitude_m=amplitude, period_s=period)
    except ValueError:
        return None


def _refined(
    fly: Callable[[FlightPlan | None], TriedFlight | None], base: FlightPlan, start: TriedFlight
) -> TriedFlight:
    best = start
    period = start.plan.period_s

    def cost(logs: FloatArray) -> float:
        nonlocal best
        speed, swing = np.exp(logs)
        one = fly(_snake(base, float(speed), float(swing), period))
        if one is None:
            return REFUSED
        best = min((best, one), key=lambda c: c.miss)
        return float(
            np.log(one.coarse_m / one.targets[0]) ** 2 + np.log(one.precise_m / one.targets[1]) ** 2
        )

    first = np.log([start.plan.speed_m_s, max(start.plan.swing_rad, 1e-3)])
    minimize(
        cost, first, method="Nelder-Mead", options={"xatol": 3e-3, "fatol": 1e-8, "maxfev": 60}
    )
    return best
