"""The experiment that would settle what is open, chosen from a menu by what it tells apart.

T-optimality: the measured effect is simulated in each experiment, and every rival is fitted to it;
the experiment counts with the whitened distance that the best rival leaves. What these runs cannot
show at all is proposed by how strongly the experiment would show it.
"""

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
from thermo.discrepancy.experiment_menu import Item, menu
from thermo.discrepancy.problem.refit import Fitted
from thermo.discrepancy.problem.source import ThermalSource
from thermo.planning.default_station import default_station
from thermo.planning.foresight import followed_by, planned_channel
from thermo.planning.plan import Plan, make_plan
from thermo.planning.sequence import Sequence, sequence_toml
from thermo.recording.channel import Channel
from thermo.selection.orders import mounted

RIVALS = 4
# A rival this many sigma away is told apart in all but one case in a thousand.
CLEAR_D = 10.0
# This many sigma away in expectation, a rival is still within an alias set in one case in twenty.
SETTLED_D = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """An experiment proposed.

    Attributes
    ----------
    text : str
    separates : tuple of str
        The effects it tells apart, or shows.
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
        """Return the sequence file that `run` takes, what it is for in its head.

        Raises
        ------
        ValueError
            If the experiment is told in words only.
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
) -> Experiment | None:
    """Propose what would tell an alias set apart, or show what these runs cannot.

    Parameters
    ----------
    source : ThermalSource
    result : SearchState
    verdict : Judgement
    invisible : tuple of str
    floor : NoiseFit

    Returns
    -------
    Experiment or None
        None when nothing is open.
    """
    if verdict.verdict in ("named", "alias"):
        for slot in result.slots:
            if len(slot.alias) > 1:
                return propose_separation(source, floor, slot.choice, slot.alias)
        if source.seen.runs == 1:
            rivals = tuple(n for n, _ in result.slots[0].rivals[:RIVALS])
            made = propose_separation(source, floor, result.slots[0].choice, rivals)
            return replace(
                made,
                text="one run and one loop do not tell thermal history from drift: " + made.text,
            )
    return _Experiments(source, floor).showing(invisible) if invisible else None


def propose_separation(
    source: ThermalSource, floor: NoiseFit, choice: Choice, rivals: Many[str]
) -> Experiment:
    """Propose what would tell one effect, at the size it has in these runs, from others.

    Parameters
    ----------
    source : ThermalSource
    floor : NoiseFit
    choice : Choice
    rivals : sequence of str
    """
    found = source.fitted([choice], floor.noise)
    return _Experiments(source, floor).separating(choice.name, (choice.name, *rivals), found)


def _better(distance: float, plan: Plan, best: "tuple[float, Item, Plan]") -> bool:
    if min(distance, best[0]) >= CLEAR_D:
        return plan.total_s < best[2].total_s
    return distance > best[0]


def _thinned(grid: Many[Theta]) -> Many[Theta]:
    """Return some points of a grid: enough to see whether one effect imitates another."""
    return grid[:: max(1, round(len(grid) / POINTS))]


class _Experiments:
    """The menu, planned once."""

    def __init__(self, source: ThermalSource, floor: NoiseFit) -> None:
        self.source, self.floor = source, floor
        channel = source.channel
        self.t_ref_c = float(channel.temp_c[0] - channel.record["x_c"][0])

    def separating(self, name: str, alias: Many[str], found: Fitted) -> Experiment:
        """Return the shortest experiment that tells the effect from every rival.

        Without one that does so clearly, the one that leaves the nearest rival farthest away.
        """
        best: tuple[float, Item, Plan] | None = None
        rivals = [n for n in alias if n != name][:RIVALS]
        before = self._distance(self._simulated(self.source.channel, found), name, rivals)
        for item, plan, channel in self._planned():
            distance = self._distance(self._simulated(channel, found), name, rivals)
            if best is None or _better(distance, plan, best):
                best = (distance, item, plan)
        if best is None:
            return self._in_words((name, *rivals))
        distance, item, plan = best
        text = (
            f"{item.text}, {plan.total_s / 3600:.0f} h; it leaves {name} {distance:.1f} sigma from "
            f"its nearest rival of {', '.join(rivals)} (these runs: {before:.1f})"
        )
        if distance < SETTLED_D:
            text += "; that may well not settle it, and nothing this chamber does tells more"
        return Experiment(
            text=text,
            separates=(name, *rivals),
            d_before=before,
            d_after=distance,
            hours=plan.total_s / 3600,
            sequence=item.sequence,
        )

    def showing(self, names: Many[str]) -> Experiment | None:
        """Return the first experiment that shows the most of effects that are invisible here.

        Among those the one where they are least like any other effect.
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
            text=f"{item.text}, {plan.total_s / 3600:.0f} h; it shows {', '.join(shown)}",
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
        for item in menu(self.source.channel):
            try:
                plan = make_plan(item.sequence, default_station(item.sequence))
            except InputError:
                continue  # outside what the station can do
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

    def _distance(self, channel: Channel, name: str, rivals: Many[str]) -> float:
        """Return how far the nearest rival stays from an effect that was simulated.

        A rival's flexible form counts, as in the search.
        """
        view = self._view(channel)
        every = {c.name: c for c in view.problem.candidates}
        against = [m for n in rivals if n in every for m in (every[n], every[n].flexible) if m]
        nearest = max((f.gain for f in Prepared(view, against).scan()), default=0.0)
        own = [f.gain for f in Prepared(view, [every[name]]).scan()] if name in every else [0.0]
        return float(np.sqrt(max(own[0] - nearest, 0.0)))

    def _apart(self, channel: Channel, names: Many[str]) -> dict[str, float]:
        """Return the effects that the runs show, and what share of each no other imitates."""
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
