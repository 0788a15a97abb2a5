"""The article's experiment by navigation outputs on the twin: ratios over seeds, and a picture.

python benchmarks/nav_experiment.py [SEEDS]
"""

import sys
from pathlib import Path

import numpy as np

from accelbench.shell.plotting import dress, legend_below, new_figure, picture
from sinscal.article.experiment import ArticleExperiment, navigation_experiment
from sinscal.calibration.nav_outputs import position_errors

PICTURE = Path(__file__).parents[1] / "docs/pictures/nav-experiment.png"


def draw(done: ArticleExperiment) -> bytes:
    figure = new_figure(9.0, 5.2)
    panels = figure.subplots(2, 1, sharex=True)
    parts = ((done.before, "#D55E00", "before"), (done.after, "#0072B2", "compensated"))
    for axes, column, name in zip(panels, (1, 0), ("north", "east"), strict=True):
        for run, colour, label in parts:
            for k, rows in enumerate(run.cycles):
                minutes = run.time_s[rows] / 60.0
                error_km = position_errors(run, rows)[:, column] / 1e3
                axes.plot(minutes, error_km, color=colour, label=label if k == 0 else None)
        dress(axes, y=f"position error {name}, km")
    panels[1].set_xlabel("time, min", fontsize=9)
    panels[0].set_title(
        "Second run, three cycles; sensors' errors estimated in the first run", fontsize=10
    )
    handles, labels = panels[0].get_legend_handles_labels()
    legend_below(figure, handles, labels)
    return picture(figure, PICTURE.name, "").png


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 12
    done = [navigation_experiment(seed) for seed in range(seeds)]
    for seed, one in enumerate(done):
        first, before, after = (x / 1e3 for x in one.largest_m)
        runs = f"first run {first:.1f} km, second {before:.1f} km -> {after:.2f} km"
        print(f"seed {seed}: {runs}, {one.ratio:.1f} times")
    ratios = [one.ratio for one in done]
    print(f"ratio: median {np.median(ratios):.1f}, least {min(ratios):.1f}")
    PICTURE.write_bytes(draw(done[0]))


if __name__ == "__main__":
    main()
