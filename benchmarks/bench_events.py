"""How many events of one strength can be found, by what is known of the noise.

    PYTHONPATH=. .venv/bin/python benchmarks/bench_events.py [--strength 14] [--draws 40]

Strength is measured by the true noise: an event of strength 14 is 14 of its sigmas for whoever
knows that noise. Four runs of 1 °C/min with rests of 1 h are simulated in block means, under white
noise of 2 µg, alone and with a drift of 3 µg over 1 h. An event counts as found when its
likelihood ratio is one that luck gives in 0.2 % of nulls: with the noise known, with its family
known and its size and correlation time not, and with nothing known of it (the nulls then are of
the noise that is likeliest without an event, which is what a measurement would be judged by).
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.blind.chamber.plan import recipe
from benchmarks.blind.chamber.truth import write_set
from errormodel.arrays import FloatArray
from errormodel.discrepancy.events import POWERS, event_ratios, noise_menu
from errormodel.discrepancy.nulls import NullDistribution
from errormodel.discrepancy.problem import Candidate, Problem
from errormodel.discrepancy.scan import View
from errormodel.noise.floor import PENALTY
from errormodel.noise.likelihood import RestrictedLikelihood
from errormodel.noise.model import NoiseModel, drifting
from thermo.discrepancy.baseline import bare_baseline
from thermo.discrepancy.problem.source import ThermalSource
from thermo.recording.channel import channel_of
from thermo.recording.files import read_runs

WHITE_UG = 5.0 / np.sqrt(6.0)  # of a block: six readings of 5 µg
NOISES = {"white": NoiseModel(), "white + OU": drifting((3.0 / WHITE_UG) ** 2, 3600.0)}
RUN_IN_H = 5.0
EVENTS = ("run_in", "bias_drift", "turn_on_offset", "bias_step")
NULLS = 300
LUCK = 0.002  # a quarter of what all four events are allowed together


def four_runs() -> Problem:
    """Return the engine's problem of four runs of the blind benchmark's first protocol."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_set(folder, folder / "key.json", recipe("nothing", "P1", "white"), [1, 1])
        runs = read_runs([folder / "run.csv"])
    channel = channel_of(runs, runs.serials[0])
    return ThermalSource(channel, bare_baseline(channel)).problem((), NoiseModel())


def signatures(
    event: Candidate, problem: Problem, count: int, rng: np.random.Generator
) -> FloatArray:
    """Return what one event leaves in the residual, drawn `count` times, any size, (n, count)."""
    if event.name == "turn_on_offset":
        columns = event.signature(()).columns
        return columns @ rng.standard_normal((columns.shape[1], count))
    if event.name == "bias_step":
        inner = event.grid[len(event.grid) // 4 : -(len(event.grid) // 4)]
        thetas = [inner[int(k)] for k in rng.integers(len(inner), size=count)]
    else:
        thetas = [(RUN_IN_H,) if event.name == "run_in" else ()] * count
    return np.column_stack([event.signature(theta).columns[:, 0] for theta in thetas])


def found(
    problem: Problem,
    event: Candidate,
    residuals: FloatArray,
    nulls: FloatArray,
    shapes: Sequence[NoiseModel],
) -> tuple[float, float]:
    """Return the share of residuals in which the event is found, and the median ratio."""
    null = NullDistribution(event_ratios(problem, shapes, nulls, [event])[0])
    ratios = event_ratios(problem, shapes, residuals, [event])[0]
    return float(np.mean(null.p_values(ratios) < LUCK)), float(np.median(ratios))


def likeliest(problem: Problem, shapes: Sequence[NoiseModel], residuals: FloatArray) -> NoiseModel:
    """Return the noise that most of the residuals are likeliest by, without an event."""
    judge = RestrictedLikelihood(problem.times, problem.base)
    values = [judge.evaluate(s, residuals)[0] - PENALTY[s.family] for s in shapes]
    best: list[int] = np.argmax(np.array(values), axis=0).tolist()
    return Counter(shapes[k] for k in best).most_common(1)[0][0]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--strength", type=float, default=14.0)
    parser.add_argument("--draws", type=int, default=40)
    asked = parser.parse_args()
    problem = four_runs()
    events = {c.name: c for c in problem.candidates if c.name in EVENTS}
    print("| event | noise | noise known | its family known | nothing known | ratio | taken for |")
    print("|---|---|---|---|---|---|---|")
    for noise, true in NOISES.items():
        whitener = true.whitener(problem.times)
        view = View(problem, true, 1.0)
        every = tuple(dict.fromkeys((true, *noise_menu(problem.times, POWERS, 4))))
        family = [s for s in every if s.family == true.family]
        for name in EVENTS:
            rng = np.random.default_rng(5)
            event, white = events[name], rng.standard_normal((len(problem.times), NULLS))
            nulls = whitener.colour(white)
            noise_drawn = whitener.colour(rng.standard_normal((len(white), asked.draws)))
            shapes = signatures(event, problem, asked.draws, rng)
            length = np.linalg.norm(view.beside_base(view.white(shapes)), axis=0)
            hidden = noise_drawn + asked.strength * shapes / length
            taken = likeliest(problem, every, hidden)
            known = found(problem, event, hidden, nulls, [true])
            own = found(problem, event, hidden, nulls, family)
            wild = found(problem, event, hidden, taken.whitener(problem.times).colour(white), every)
            print(
                f"| {name} | {noise} | {known[0]:.0%} | {own[0]:.0%} | {wild[0]:.0%} "
                f"| {known[1]:.0f}, {own[1]:.0f}, {wild[1]:.0f} | {taken.family} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
