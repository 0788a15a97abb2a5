"""How often the limits of `stability` and `runin` hold what they say they hold.

    PYTHONPATH=. .venv/bin/python benchmarks/bench_stability_coverage.py same --runs 2
    PYTHONPATH=. .venv/bin/python benchmarks/bench_stability_coverage.py differing --runs 5
    PYTHONPATH=. .venv/bin/python benchmarks/bench_stability_coverage.py runin --law creep

`same`: runs of four hours that do not differ at all (5 µg white, 3 µg of drift correlated over one
hour); `differing`: K0 by 20 µg, K1 by 10 ppm, its slope by 0.1 µg/°C from run to run. Shares are of
the sets in which limits hold the truth; the spread should lie above its truth in half of them.

`runin`: K0 and K1 known to 2 µg and 2 ppm, limits of 15, looked at after eight of the cycles
5 to 25 until the rule stops. Told are the share of sets stopped, the share of these with a later
change above a limit within 60 cycles, the cycle of the stop beside that where it could have been,
and how often more cycles were needed than the upper end of "cycles still needed" said.
The tests of the suite run the same functions with few sets.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy

import argparse

from tests.thermo.stability.coverage import LAWS, run_in_coverage, stability_coverage


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("same", "differing", "runin"))
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="Seed of the first set.")
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--readings", type=int, default=240, help="Of a run.")
    parser.add_argument("--law", choices=tuple(LAWS), default="exponential")
    parser.add_argument("--nothing-slow", action="store_true", help="Assume it, as the rule may.")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.sets)
    if asked.what == "runin":
        found = run_in_coverage(asked.law, seeds, nothing_slow=asked.nothing_slow)
        print(f"{asked.law}: {found.text}")
        return
    moves = asked.what == "differing"
    print(asked.what, asked.runs, stability_coverage(asked.runs, seeds, moves, asked.readings).text)


if __name__ == "__main__":
    main()
