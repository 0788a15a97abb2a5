"""Serve an emulated station until standard input ends; its station file goes to standard output."""

import sys

from drivers.clock import ScaledClock
from thermo.launch.emulated import emulated
from thermo.planning.default_station import default_station
from thermo.planning.sequence import load_sequence


def say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def main() -> None:
    speed, sequence_path = float(sys.argv[1]), sys.argv[2]
    config = default_station(load_sequence(sequence_path))
    with emulated(config, ScaledClock(speed)) as station:
        say(station.config.model_dump_json())
        sys.stdin.read()


if __name__ == "__main__":
    main()
