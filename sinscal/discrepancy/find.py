"""The verdict on a rig run: the physical effect that the filter's model lacks."""

from dataclasses import dataclass

import numpy as np

from errormodel.discrepancy.foresight import NAMEABLE_D, Foresight
from errormodel.discrepancy.gate import FactorFinding
from errormodel.discrepancy.investigation import Conclusion, Settings, Tell, investigate
from errormodel.discrepancy.search.choices import Choice, Rules
from errormodel.discrepancy.search.state import Slot
from errormodel.noise.model import NoiseModel
from sinscal.calibration.noise import noise_of_run
from sinscal.calibration.rig import Mode
from sinscal.discrepancy.held_out import CycleGap, gaps_by_cycle, rms_by_channel
from sinscal.discrepancy.measurement import RigInnovations
from sinscal.discrepancy.noise import MeasuredNoise, measured_noise
from sinscal.discrepancy.source import RigSource
from sinscal.library import rig_library
from sinscal.library.angle import MOUNTING
from sinscal.library.groups import RigEffect
from sinscal.model.larger_model import RigModelFile, check_needs
from sinscal.recording.run import RigRun
from sinscal.sensitivity.drift import Drift
from sinscal.sensitivity.problem import FilterProblem

# A jump of strength seven, the smallest to be named, explains 49, of which some 10 are due to
# chance. A jump that explains less beside a strong effect may be due to the uncertain shape of that
# effect.
RULES = Rules(further_event=Rules().further)
DRAWS = 1000  # the largest hundred form the tail of a null distribution
# Smallest number of draws for a long run, for which all draws would need more than 0.25 GB.
LEAST_DRAWS, MOST_NUMBERS = 200, 30_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One parameter of an effect, estimated by the enlarged filter; SI."""

    value: float
    sigma: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RigEffectFound:
    """A named effect: its parameters, strength (sigma of its own size) and p over the library."""

    effect: RigEffect
    parameters: dict[str, Estimate]
    strength_d: float
    p_value: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigDiscrepancy(Conclusion[CycleGap, str]):
    """The verdict on one rig run and its basis.

    Attributes
    ----------
    source : RigSource
    noise : tuple of MeasuredNoise
        The measured densities, used by all tests here.
    effects : tuple of RigEffectFound
    where : str or None
        The factor that the named effect's error follows; without a name, the one that explains most
        of the excess.
    channel : str or None
        The channel in which the excess is largest.
    rms_before, rms_after, floor : dict of str to float
        Rms of innovations by channel, m/s² and rad; the floor is that of the noise.
    gaps : tuple of CycleGap
        By cycle, of the filters of the present and the larger model; those of `held_out_parts` use
        effects selected and estimated by the other cycles alone.
    smallest_nameable : dict of str to (float, str)
        Size of the effect's first visible parameter at strength seven, and its unit.
    """

    source: RigSource
    noise: tuple[MeasuredNoise, ...]
    effects: tuple[RigEffectFound, ...]
    where: str | None
    channel: str | None
    rms_before: dict[str, float]
    rms_after: dict[str, float]
    floor: dict[str, float]
    gaps: tuple[CycleGap, ...]
    smallest_nameable: dict[str, tuple[float, str]]

    @property
    def drift(self) -> Drift | None:
        """The slow drift of the constant errors that the run shows; an alias set may hold it."""
        return self.rival if isinstance(self.rival, Drift) else None


def find_rig_discrepancy(
    run: RigRun,
    *,
    mode: Mode | None = None,
    present: RigModelFile | None = None,
    rules: Rules | None = None,
    draws: int = DRAWS,
    seed: int = 1,
    tell: Tell = lambda line: None,
) -> RigDiscrepancy:
    """Find and name the missing effect in the model of a SINS from a recorded rig run.

    Parameters
    ----------
    run : RigRun
        The stated noise densities are the start values of their estimates.
    mode : {"coarse", "precise"}, optional
        By default as the present model says, or precise where the rig's angle is recorded.
    present : RigModelFile, optional
        The present model; by default the basic errors alone (`sinscal.library.BASIC`).
    rules : Rules, optional
    draws : int
        Simulated nulls that calibrate every statistic; fewer for a run of many hours.
    seed : int
        Seed of the draws.
    tell : callable, optional
        Takes a line of progress.

    Returns
    -------
    RigDiscrepancy

    Raises
    ------
    InputError
        If the run lacks what the mode needs.
    """
    rules = rules or RULES
    angle = run.rig_angle_rad is not None and run.facts.axis_of_cycle is not None
    by_data: Mode = "precise" if angle else "coarse"
    mode = mode or (present.mode if present else by_data)
    if present:
        check_needs(present.groups, run, mode)
    first = noise_of_run(run, angle=mode == "precise").noise
    source = RigSource(run, mode, first, present=present or RigModelFile())
    tell("calibrating with the present model")
    noise, measured = measured_noise(source)
    tell("again with the noise measured in the run")
    source = source.with_noise(noise)
    numbers = source.problem((), NoiseModel()).residual.size
    settings = Settings(
        rules=rules,
        draws=min(draws, max(LEAST_DRAWS, MOST_NUMBERS // numbers)),
        seed=seed,
        tell=tell,
    )
    ((measurement, conclusion),) = investigate([RigInnovations(source)], settings)
    return _discrepancy(measurement, conclusion, measured)


def _discrepancy(
    measurement: RigInnovations,
    conclusion: Conclusion[CycleGap, str],
    measured: tuple[MeasuredNoise, ...],
) -> RigDiscrepancy:
    """Collect the verdict and its basis."""
    source, choices = measurement.source, conclusion.choices
    before, after = source.filter_with(()), source.filter_with(choices)
    slots = conclusion.result.slots if choices else ()
    return RigDiscrepancy(
        **conclusion.inherited,
        source=source,
        noise=measured,
        effects=tuple(_found(_without(source, choices, s), after, s) for s in slots),
        where=_where(slots, conclusion.places),
        channel=_loudest(before) if conclusion.verdict != "nothing" else None,
        rms_before=_channel_rms(before),
        rms_after=_channel_rms(after),
        floor=_floor(after),
        gaps=gaps_by_cycle(before, after, choices),
        smallest_nameable=_smallest(conclusion.foresight, before),
    )


def _without(source: RigSource, choices: tuple[Choice, ...], slot: Slot) -> FilterProblem:
    """Return the filter with all chosen effects except one."""
    return source.filter_with([c for c in choices if c != slot.choice])


def _found(before: FilterProblem, after: FilterProblem, slot: Slot) -> RigEffectFound:
    effect, found = rig_library().by_name[slot.choice.name], after.found
    described = [*found.sensors.parameters.values(), *MOUNTING]
    parameters = {
        one.name: Estimate(value=found.value(one.name), sigma=found.sigma(one.name), unit=one.unit)
        for one in described
        if one.name in found.names and effect.owns(one)
    }
    if effect.step:
        at_s = slot.choice.theta[0]
        sigma = before.time_sigma_s(effect, slot.choice.theta)
        at = Estimate(value=at_s, sigma=sigma, unit="s")
        parameters[f"{effect.name}_at_s"] = at
    return RigEffectFound(
        effect=effect,
        parameters=parameters,
        strength_d=float(np.sqrt(max(slot.gain, 0.0))),
        p_value=slot.p_value,
    )


def _where(slots: tuple[Slot, ...], places: tuple[FactorFinding, ...]) -> str | None:
    """Return the factor to report.

    The filter integrates gyro errors, so its innovations follow a factor less closely than the
    readings do. For a named effect, its own factor is reported.
    """
    if slots:
        strongest = max(slots, key=lambda s: s.gain)
        return rig_library().by_name[strongest.choice.name].follows
    return places[0].name if places else None


def _loudest(one: FilterProblem) -> str:
    """Return the channel with the largest excess of its innovations over their noise."""
    seen = one.found.filtered
    beyond = np.nansum(np.where(one.kept, seen.innovation**2 / seen.variance - 1.0, 0.0), axis=0)
    return one.rows.names[int(np.argmax(beyond))]


def _channel_rms(one: FilterProblem) -> dict[str, float]:
    return rms_by_channel(one, one.found.filtered.innovation**2)


def _floor(one: FilterProblem) -> dict[str, float]:
    return rms_by_channel(one, one.found.filtered.variance)


def _smallest(foresight: Foresight, before: FilterProblem) -> dict[str, tuple[float, str]]:
    """Return the smallest size of each visible effect that can be named, with its unit."""
    return {
        name: (NAMEABLE_D / strength, before.unit_of(rig_library().by_name[name]))
        for name, strength in zip(foresight.names, foresight.strength.tolist(), strict=True)
        if strength > 0.0
    }
