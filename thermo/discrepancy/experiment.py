"""Selection of the experiment that separates the open candidates best.

T-optimality: the measured effect is simulated in each experiment, and every rival is fitted to it;
the criterion is the whitened distance of the best rival. For effects that these runs cannot show,
the criterion is the strength with which the experiment would show them.
"""

import math
from collections.abc import Mapping
from collections.abc import Sequence as Many
from dataclasses import dataclass, replace

import numpy as np

from errormodel.discrepancy.gate import Judgement
from errormodel.discrepancy.problem import Signature, Theta, columns_of
from errormodel.discrepancy.scan import Prepared, View
from errormodel.discrepancy.search.choices import Choice
from errormodel.discrepancy.search.pairs import POINTS
from errormodel.discrepancy.search.state import SearchState
from errormodel.errors import InputError
from errormodel.noise.model import NoiseFit
from thermo.discrepancy.experiment_menu import NO_LIMITS, Item, Limits, menu
from thermo.discrepancy.problem.refit import Fitted
from thermo.discrepancy.problem.source import ThermalSource
from thermo.planning.default_station import default_station
from thermo.planning.foresight import followed_by, planned_channel
from thermo.planning.plan import Plan, make_plan
from thermo.planning.sequence import Sequence, sequence_toml
from thermo.recording.channel import Channel
from thermo.selection.orders import mounted

RIVALS = 4
# A rival at this distance in sigmas is separated in all but one case in a thousand.
CLEAR_D = 10.0
# At this expected distance in sigmas, a rival is still in an alias set in one case in twenty.
SETTLED_D = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """A proposed experiment.

    Attributes
    ----------
    text : str
    separates : tuple of str
        The effects that it separates, or shows.
    d_before, d_after : float or None
        Whitened distance of the nearest rival in these runs, and expected with the experiment.
    hours : float or None
    sequence : Sequence or None
    """

    text: str
    separates: tuple[str, ...]
    d_before: float | None
    d_after: float | None
    hours: float | None
    sequence: Sequence | None

    def toml(self) -> str:
        """Return the sequence file for `run`, with its purpose in the heading.

        Raises
        ------
        ValueError
            If the experiment is described in words only.
        """
        if self.sequence is None:
            raise ValueError("this experiment has no sequence")
        return "".join(f"# {line}\n" for line in self.text.split("\n")) + sequence_toml(
            self.sequence
        )


def propose(
    source: ThermalSource,
    result: SearchState,
    verdict: Judgement,
    invisible: tuple[str, ...],
    floor: NoiseFit,
    limits: Limits = NO_LIMITS,
) -> Experiment | None:
    """Propose an experiment that separates an alias set, or shows invisible effects.

    Parameters
    ----------
    source : ThermalSource
    result : SearchState
    verdict : Judgement
    invisible : tuple of str
    floor : NoiseFit
    limits : Limits
        What the laboratory can do.

    Returns
    -------
    Experiment or None
        None when nothing is open.
    """
    if verdict.verdict in ("named", "alias"):
        for slot in result.slots:
            if len(slot.alias) > 1:
                return propose_separation(
                    source, floor, slot.choice, slot.alias, slot.weights, limits
                )
        if source.seen.runs == 1:
            rivals = tuple(n for n, _ in result.slots[0].rivals[:RIVALS])
            first = result.slots[0]
            made = propose_separation(source, floor, first.choice, rivals, first.weights, limits)
            return replace(
                made,
                text="one run and one loop cannot separate thermal history from drift: "
                + made.text,
            )
    return _Experiments(source, floor, limits).showing(invisible) if invisible else None


def propose_separation(
    source: ThermalSource,
    floor: NoiseFit,
    choice: Choice,
    rivals: Many[str],
    weights: Mapping[str, float] | None = None,
    limits: Limits = NO_LIMITS,
) -> Experiment:
    """Propose an experiment that separates one effect, at its size in these runs, from others.

    Parameters
    ----------
    source : ThermalSource
    floor : NoiseFit
    choice : Choice
    rivals : sequence of str
    weights : mapping of str to float, optional
        Posterior weight of each; alike by default.
    limits : Limits
    """
    found = source.fitted([choice], floor.noise)
    experiments = _Experiments(source, floor, limits)
    return experiments.separating(choice.name, (choice.name, *rivals), found, weights or {})


@dataclass(frozen=True, slots=True, eq=False)
class _Outcome:
    """Value of an experiment: sigma between the effect and each rival, and the pairs it decides.

    `decided` is the share of the rivals' posterior weight that it is expected to take away: two
    hypotheses d sigma apart are mistaken for each other with a probability below exp(−d²/8)
    (Chernoff).
    """

    distances: Mapping[str, float]
    decided: float
    item: Item
    hours: float

    @property
    def nearest(self) -> float:
        return min(self.distances.values())

    def rank(self, most: float) -> tuple[int, float]:
        """Return the order of choice: a clear one by its hours, else what an hour decides."""
        if self.nearest >= CLEAR_D:
            return 2, -self.hours
        worth = self.decided >= 0.5 * most  # of what the best of them decides
        return int(worth), self.decided / self.hours


def _thinned(grid: Many[Theta]) -> Many[Theta]:
    """Return some points of a grid: enough to test whether one effect imitates another."""
    return grid[:: max(1, round(len(grid) / POINTS))]


class _Experiments:
    """The menu, planned once."""

    def __init__(self, source: ThermalSource, floor: NoiseFit, limits: Limits) -> None:
        self.source, self.floor, self.limits = source, floor, limits
        channel = source.channel
        self.t_ref_c = float(channel.temp_c[0] - channel.record["x_c"][0])

    def separating(
        self, name: str, alias: Many[str], found: Fitted, weights: Mapping[str, float]
    ) -> Experiment:
        """Return the experiment that decides most an hour between the effect and its rivals.

        The shortest of those that tell it from every rival clearly, where there is one.
        """
        rivals = [n for n in alias if n != name][:RIVALS]
        before = min(
            self._distances(self._simulated(self.source.channel, found), name, rivals).values()
        )
        outcomes = [
            self._outcome(item, plan, self._simulated(channel, found), name, rivals, weights)
            for item, plan, channel in self._planned()
        ]
        if not outcomes:
            return self._in_words((name, *rivals))
        most = max(o.decided for o in outcomes)
        best = max(outcomes, key=lambda o: o.rank(most))
        text = (
            f"{best.item.text}, {best.hours:.0f} h; it separates {name} from {', '.join(rivals)}: "
            f"{best.nearest:.1f} sigma to the nearest of them, {before:.1f} in these runs"
        )
        if best.nearest < SETTLED_D:
            text += (
                f"; it is expected to decide {best.decided:.0%} of what is open, and nothing "
                "within these limits decides more an hour"
            )
        return Experiment(
            text=text,
            separates=(name, *rivals),
            d_before=before,
            d_after=best.nearest,
            hours=best.hours,
            sequence=best.item.sequence,
        )

    def _outcome(
        self,
        item: Item,
        plan: Plan,
        channel: Channel,
        name: str,
        rivals: Many[str],
        weights: Mapping[str, float],
    ) -> _Outcome:
        distances = self._distances(channel, name, rivals)
        own = {n: weights.get(n, 0.0) or 1e-3 for n in rivals}
        told = sum(own[n] * (1.0 - math.exp(-(d**2) / 8.0)) for n, d in distances.items())
        return _Outcome(distances, told / sum(own.values()), item, plan.total_s / 3600)

    def showing(self, names: Many[str]) -> Experiment | None:
        """Return the first experiment that shows the largest number of invisible effects.

        Among equal ones, the one in which they are least similar to other effects.
        """
        best: tuple[tuple[int, float], tuple[str, ...], Item, Plan] | None = None
        for item, plan, channel in self._planned():
            apart = self._apart(channel, names)
            rank = len(apart), round(sum(apart.values()), 2)
            if best is None or rank > best[0]:
                best = (rank, tuple(apart), item, plan)
        if best is None or not best[1]:
            return self._in_words(names)
        _, shown, item, plan = best
        return Experiment(
            text=f"{item.text}, {plan.total_s / 3600:.0f} h; it shows {', '.join(shown)}, which "
            "these runs cannot",
            separates=shown,
            d_before=0.0,
            d_after=None,
            hours=plan.total_s / 3600,
            sequence=item.sequence,
        )

    def _in_words(self, names: Many[str]) -> Experiment:
        known = {e.name: e for e in self.source.effects}
        return Experiment(
            text="; ".join(f"{n}: {known[n].experiment}" for n in names),
            separates=tuple(names),
            d_before=None,
            d_after=None,
            hours=None,
            sequence=None,
        )

    def _planned(self) -> list[tuple[Item, Plan, Channel]]:
        """Return the menu's experiments that an emulated station takes, after the runs at hand."""
        made: list[tuple[Item, Plan, Channel]] = []
        for item in menu(self.source.channel, self.limits):
            try:
                plan = make_plan(item.sequence, default_station(item.sequence))
            except InputError:
                continue  # outside what the station can do
            if plan.total_s > 3600.0 * self.limits.most_hours:
                continue
            runs = [plan.run(k + 1) for k in range(plan.runs)]
            turned = item.sequence.accelerometers[0].mount_deg
            planned = planned_channel(runs, self.t_ref_c, turned)
            made.append((item, plan, followed_by(self.source.channel, planned)))
        return made

    def _simulated(self, channel: Channel, found: Fitted) -> Channel:
        record = channel.record
        output = found.model.simulate(record, found.values)
        made = type(record)(
            time_s=record.time_s, run=record.run, signals=record.signals, output=output
        )
        return replace(channel, record=made)

    def _view(self, channel: Channel) -> View:
        part = ThermalSource(channel, mounted(self.source.model, channel), self.source.effects)
        # the white part is that of a usual block, which may hold more readings now
        more = part.blocks.usual / self.source.blocks.usual
        given = self.floor.noise
        noise = replace(given, white=given.white / float(np.sqrt(more)), continued=False)
        return View(part.outline(noise), noise)

    def _distances(self, channel: Channel, name: str, rivals: Many[str]) -> dict[str, float]:
        """Return how far each rival stays from an effect that was simulated.

        A rival's flexible form counts, as in the search.
        """
        view = self._view(channel)
        every = {c.name: c for c in view.problem.candidates}
        own = [f.gain for f in Prepared(view, [every[name]]).scan()] if name in every else [0.0]
        made: dict[str, float] = {}
        for rival in rivals:
            forms = (
                [m for m in (every[rival], every[rival].flexible) if m] if rival in every else []
            )
            nearest = max((f.gain for f in Prepared(view, forms).scan()), default=0.0)
            made[rival] = float(np.sqrt(max(own[0] - nearest, 0.0)))
        return made

    def _apart(self, channel: Channel, names: Many[str]) -> dict[str, float]:
        """Return the visible effects, and the share of each that no other effect imitates."""
        record = channel.record
        perfect = type(record)(
            time_s=record.time_s, run=record.run, signals=record.signals, output=record["a_i_g"]
        )
        view = self._view(replace(channel, record=perfect))
        every = {
            c.name: [Signature(columns=columns_of(c.signature(t))) for t in _thinned(c.grid)]
            for c in view.problem.candidates
        }
        points = {name: view.points(own) for name, own in every.items()}
        made: dict[str, float] = {}
        for name in (n for n in names if any(p.basis.shape[1] for p in points.get(n, ()))):
            middle = every[name][len(every[name]) // 2].columns
            left = view.beside_base(view.white(middle))
            length2 = np.sum(left**2, axis=0)
            own = left[:, [int(np.argmax(length2))]]
            gains = [view.gains(p, own).max() for n, p in points.items() if n != name]
            made[name] = 1.0 - float(np.max(gains, initial=0.0)) / float(np.max(length2))
        return made
