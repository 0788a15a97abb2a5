"""Which physical effect is missing from the rig filter's model, found in its innovations."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from errormodel.discrepancy.choices import Choice, Rules, SearchResult, Slot
from errormodel.discrepancy.floor import NoiseFloor
from errormodel.discrepancy.foresight import NAMEABLE_D, foresee
from errormodel.discrepancy.gate import Conclusion, FactorFinding, Judgement, judge, locate
from errormodel.discrepancy.nulls import Calibration
from errormodel.discrepancy.nulls import calibrate as simulate_nulls
from errormodel.discrepancy.scan import View
from errormodel.discrepancy.search import Search
from errormodel.noise.shapes import NoiseShape
from sinscal.calibration.noise import noise_of_run
from sinscal.calibration.rig import Mode
from sinscal.discrepancy.drift import against_drift
from sinscal.discrepancy.held_out import CycleGap, gaps_by_cycle, held_out, rms_by_channel
from sinscal.discrepancy.noise import MeasuredNoise, measured_noise
from sinscal.discrepancy.source import RigSource
from sinscal.library import rig_library
from sinscal.library.angle import MOUNTING
from sinscal.library.groups import RigEffect
from sinscal.model.larger_model import RigModelFile, check_needs
from sinscal.recording.run import RigRun
from sinscal.sensitivity.drift import Drift
from sinscal.sensitivity.problem import FilterProblem

# A jump of strength seven, the least that is to be named, explains 49, and luck some 10 of it: one
# that explains less beside a strong effect follows what is not known of that one's shape.
RULES = Rules(further_event=Rules().further)
DRAWS = 1000  # of which the uppermost hundred make the tail of a law
# Fewer, yet not fewer than so many, of a run so long that all draws would be more than a quarter of
# a gigabyte.
LEAST_DRAWS, MOST_NUMBERS = 200, 30_000_000
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One parameter of an effect as the enlarged filter found it; SI."""

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
class RigDiscrepancy(Conclusion):
    """The verdict on one rig run and what it stands on.

    Attributes
    ----------
    judgement, result
        Of every `Conclusion`.
    source : RigSource
    noise : tuple of MeasuredNoise
        The densities as measured, which everything here was judged by.
    effects : tuple of RigEffectFound
    where : str or None
        The factor that the named effect's error follows; without a name, the one that carries most
        of the excess.
    channel : str or None
        The channel in which the excess is largest.
    places : tuple of FactorFinding
        Every factor with how much of the excess it carries, the best first.
    rms_before, rms_after, floor : dict of str to float
        Of innovations by channel, m/s² and rad; the floor is what the noise gives.
    gaps, heldout : tuple of CycleGap
        By cycle: of the filters of the present and the larger model; and with the effects chosen
        and sized by the other cycles alone.
    invisible : tuple of str
    smallest_nameable : dict of str to (float, str)
        Size of the effect's first visible unknown at strength seven, and its unit.
    experiment : str or None
    drift : Drift or None
        The slow drift of the constant errors that the run shows; an alias set may hold it.
    """

    source: RigSource
    noise: tuple[MeasuredNoise, ...]
    effects: tuple[RigEffectFound, ...]
    where: str | None
    channel: str | None
    places: tuple[FactorFinding, ...]
    rms_before: dict[str, float]
    rms_after: dict[str, float]
    floor: dict[str, float]
    gaps: tuple[CycleGap, ...]
    heldout: tuple[CycleGap, ...]
    invisible: tuple[str, ...]
    smallest_nameable: dict[str, tuple[float, str]]
    experiment: str | None
    drift: Drift | None


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
    """Find and name what is missing from the model of a SINS in a recorded rig run.

    Parameters
    ----------
    run : RigRun
        Densities of noise that its facts state are where their measurement begins from.
    mode : {"coarse", "precise"}, optional
        By default as the present model says, or precise where the rig's angle is recorded.
    present : RigModelFile, optional
        The present model; by default the basic errors alone (`sinscal.library.BASIC`).
    rules : Rules, optional
    draws : int
        Simulated nulls that calibrate every statistic; of a run of many hours fewer are made.
    seed : int
        Of the draws.
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
    tell("again with the noise that the run shows")
    source = source.with_noise(noise)
    problem = source.problem((), NoiseShape())
    floor = NoiseFloor(shape=NoiseShape(), sigma=1.0, support=((1.0, NoiseShape()),))
    draws = min(draws, max(LEAST_DRAWS, MOST_NUMBERS // problem.residual.size))
    tell(f"{draws} simulated nulls")
    laws = simulate_nulls(problem, floor, draws=draws, rng=np.random.default_rng(seed))
    search = Search(source, floor, laws, rules)
    tell(f"trying {len(problem.candidates)} effects")
    result = search.run()
    choices = tuple(s.choice for s in result.slots)
    verdict = judge(search.view(choices), result, laws, rules, too_much_drift=False)
    places = locate(search.view(()), laws) if verdict.verdict != "nothing" else ()
    verdict = outdone(verdict, result, places, laws, rules)
    verdict, result, drift = against_drift(source.filter_with(()), verdict, result)
    if verdict.verdict not in ("named", "alias"):
        choices = ()
    before, after = source.filter_with(()), source.filter_with(choices)
    slots = result.slots if choices else ()
    invisible, smallest = _foreseen(source, search.view(()), before)
    return RigDiscrepancy(
        source=source,
        noise=measured,
        judgement=verdict,
        result=result,
        effects=tuple(_found(_without(source, choices, s), after, s) for s in slots),
        where=_where(slots, places),
        channel=_loudest(before) if verdict.verdict != "nothing" else None,
        places=places,
        rms_before=_rms(before),
        rms_after=_rms(after),
        floor=_floor(after),
        gaps=gaps_by_cycle(before, after, choices),
        heldout=held_out(source, search, choices),
        invisible=invisible,
        smallest_nameable=smallest,
        experiment=_experiment(result, verdict, invisible),
        drift=drift,
    )


def outdone(
    verdict: Judgement,
    result: SearchResult,
    places: tuple[FactorFinding, ...],
    laws: Calibration,
    rules: Rules,
) -> Judgement:
    """Withdraw names that explain clearly less than a factor alone does.

    A factor sees a part of what is there, and the effects that are truly missing explain all of it.
    So where a factor explains more, by more than luck gives it, what is there is something else: a
    slow drift, for instance, which a jump and two effects more would follow in part. Where the
    names leave nothing, they stand: a factor that explains more then follows the linearisation.
    """
    quiet = not (verdict.loud or verdict.loud_noise)
    if quiet or verdict.verdict not in ("named", "alias"):
        return verdict
    by_luck = sum(laws.gains[s.choice.name].mean for s in result.slots)
    explained = result.explained - by_luck
    for place in places:
        law = laws.factors[place.name]
        luck = float(np.quantile(law.draws, 1.0 - rules.alpha_rest)) - law.mean
        if place.excess - luck > explained:
            return replace(
                verdict,
                verdict="unexplained_repeatable" if place.repeatable else "unexplained_noise",
                explained_share=max(explained, 0.0) / place.excess,
            )
    return verdict


def _without(source: RigSource, choices: tuple[Choice, ...], slot: Slot) -> FilterProblem:
    """Return the filter that has all effects chosen but one."""
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
    """Return the factor to point to.

    The filter carries an error of the gyros on: its innovations follow no factor as closely as
    the readings do. So of an effect with a name its own factor is told.
    """
    if slots:
        strongest = max(slots, key=lambda s: s.gain)
        return rig_library().by_name[strongest.choice.name].follows
    return places[0].name if places else None


def _loudest(one: FilterProblem) -> str:
    """Return the channel whose innovations are beyond their noise by most."""
    seen = one.found.filtered
    beyond = np.nansum(np.where(one.kept, seen.innovation**2 / seen.variance - 1.0, 0.0), axis=0)
    return one.rows.names[int(np.argmax(beyond))]


def _rms(one: FilterProblem) -> dict[str, float]:
    return rms_by_channel(one, one.found.filtered.innovation**2)


def _floor(one: FilterProblem) -> dict[str, float]:
    return rms_by_channel(one, one.found.filtered.variance)


def _foreseen(
    source: RigSource, view: View, before: FilterProblem
) -> tuple[tuple[str, ...], dict[str, tuple[float, str]]]:
    """Return what the run cannot show, and the smallest size of the rest that can be named."""
    foresight = foresee(view, view.problem.candidates)
    recorded = {e.name for e in source.shown}
    unrecorded = [e.name for e in source.effects if not (e.name in recorded or source.holds(e))]
    smallest: dict[str, tuple[float, str]] = {}
    for name, strength in zip(foresight.names, foresight.strength.tolist(), strict=True):
        if strength > 0.0:
            smallest[name] = (NAMEABLE_D / strength, before.unit_of(rig_library().by_name[name]))
    return (*foresight.invisible, *unrecorded), smallest


def _experiment(result: SearchResult, verdict: Judgement, invisible: tuple[str, ...]) -> str | None:
    """Say what would settle what is open."""
    open_names = [n for s in result.slots if len(s.alias) > 1 for n in s.alias]
    if verdict.verdict == "alias":
        return "; ".join(
            f"{n}: {rig_library().by_name[n].experiment}" for n in dict.fromkeys(open_names)
        )
    if verdict.verdict.startswith("unexplained"):
        return "repeat the same programme: what comes again belongs to the model, the rest does not"
    if invisible:
        return "; ".join(f"{n}: {rig_library().by_name[n].experiment}" for n in invisible)
    return None
