"""The experiment that would settle what is open, chosen from a menu by what it tells apart.

T-optimality: the measured effect is simulated in each experiment, and every rival is fitted to it;
the experiment counts with the whitened distance that the best rival leaves. What these runs cannot
show at all is proposed by how strongly the experiment would show it.
"""

from collections.abc import Sequence as Many
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.choices import SearchResult
from errormodel.discrepancy.floor import NoiseFloor
from errormodel.discrepancy.gate import Judgement
from errormodel.discrepancy.scan import Prepared, View
from errormodel.errors import InputError
from thermo.discrepancy_source import Fitted, ThermalSource
from thermo.experiment_menu import Item, menu
from thermo.foresight import planned_channel
from thermo.inputs import Channel
from thermo.plan import Plan, make_plan
from thermo.sequence import Sequence, sequence_toml
from thermo.station_emulated import default_station

RIVALS = 4
# A rival this many sigma away is told apart in all but one case in a thousand.
CLEAR_D = 10.0


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
    result: SearchResult,
    verdict: Judgement,
    invisible: tuple[str, ...],
    floor: NoiseFloor,
) -> Experiment | None:
    """Propose what would tell an alias set apart, or show what these runs cannot.

    Parameters
    ----------
    source : ThermalSource
    result : SearchResult
    verdict : Judgement
    invisible : tuple of str
    floor : NoiseFloor

    Returns
    -------
    Experiment or None
        None when nothing is open.
    """
    experiments = _Experiments(source, floor)
    if verdict.verdict in ("named", "alias"):
        for slot in result.slots:
            if len(slot.alias) > 1:
                found = source.fitted([slot.choice], floor.shape)
                return experiments.separating(slot.choice.name, slot.alias, found)
        if source.seen.runs == 1:
            names = tuple(s.choice.name for s in result.slots)
            rivals = tuple(n for n, _ in result.slots[0].rivals[:RIVALS])
            found = source.fitted([result.slots[0].choice], floor.shape)
            made = experiments.separating(names[0], (names[0], *rivals), found)
            return replace(
                made,
                text="one run and one loop do not tell thermal history from drift: " + made.text,
            )
    return experiments.showing(invisible) if invisible else None


def _better(distance: float, plan: Plan, best: "tuple[float, Item, Plan]") -> bool:
    if min(distance, best[0]) >= CLEAR_D:
        return plan.total_s < best[2].total_s
    return distance > best[0]


class _Experiments:
    """The menu, planned once."""

    def __init__(self, source: ThermalSource, floor: NoiseFloor) -> None:
        self.source, self.floor = source, floor

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
        return Experiment(
            text=text,
            separates=(name, *rivals),
            d_before=before,
            d_after=distance,
            hours=plan.total_s / 3600,
            sequence=item.sequence,
        )

    def showing(self, names: Many[str]) -> Experiment | None:
        """Return the first experiment that shows the most of effects that are invisible here."""
        best: tuple[tuple[str, ...], Item, Plan] | None = None
        for item, plan, channel in self._planned():
            shown = tuple(n for n in names if n in self._visible(channel))
            if best is None or len(shown) > len(best[0]):
                best = (shown, item, plan)
        if best is None or not best[0]:
            return self._in_words(names)
        shown, item, plan = best
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
        """Return the menu's experiments that an emulated station takes."""
        made: list[tuple[Item, Plan, Channel]] = []
        for item in menu(self.source.channel):
            try:
                plan = make_plan(item.sequence, default_station(item.sequence))
            except InputError:
                continue  # outside what the station can do
            runs = [plan.run(k + 1) for k in range(plan.runs)]
            made.append((item, plan, planned_channel(runs, 25.0)))
        return made

    def _simulated(self, channel: Channel, found: Fitted) -> Channel:
        record = channel.record
        output = found.model.simulate(record, found.values)
        made = type(record)(
            time_s=record.time_s, run=record.run, signals=record.signals, output=output
        )
        return replace(channel, record=made)

    def _view(self, channel: Channel) -> View:
        part = ThermalSource(channel, self.source.model, self.source.effects)
        shape = replace(self.floor.shape, continued=False)
        return View(part.problem((), shape), shape, self.floor.sigma)

    def _distance(self, channel: Channel, name: str, rivals: Many[str]) -> float:
        """Return how far the nearest rival stays from an effect that was simulated."""
        view = self._view(channel)
        wanted = [c for c in view.problem.candidates if c.name in (name, *rivals)]
        gains = {f.candidate.name: f.gain for f in Prepared(view, wanted).scan()}
        nearest = max((gains[n] for n in rivals if n in gains), default=0.0)
        return float(np.sqrt(max(gains.get(name, 0.0) - nearest, 0.0)))

    def _visible(self, channel: Channel) -> set[str]:
        flat: FloatArray = np.zeros(len(channel.record))
        record = type(channel.record)(
            time_s=channel.record.time_s,
            run=channel.record.run,
            signals=channel.record.signals,
            output=channel.record["a_i_g"] + flat,
        )
        view = self._view(replace(channel, record=record))
        prepared = Prepared(view, view.problem.candidates)
        return {
            c.name
            for c, points in zip(prepared.candidates, prepared.points, strict=True)
            if any(p.basis.shape[1] or p.whole is not None for p in points)
        }
