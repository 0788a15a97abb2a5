"""Run or resume a test; every acknowledged reading and every event is told on standard output."""

import sys
from pathlib import Path

from drivers.clock import ScaledClock
from drivers.station import StationConfig
from thermo.launch.real import run_on_station
from thermo.planning.sequence import load_sequence
from thermo.station.job import make_job, make_resumed_job


def say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


class Teller:
    def on_reading(self, run, rows):
        for row in rows:
            say("ack", run, row.slot, row.attempt, row.serial, repr(row.output))

    def on_progress(self, progress):
        say("test", progress.test_id)

    def on_event(self, event):
        say("event", event.kind.replace(" ", "-"))


def main() -> None:
    speed, sequence_path, config_path, store_path, resume, *silence = sys.argv[1:]
    station = StationConfig.model_validate_json(Path(config_path).read_text(encoding="utf-8"))
    if resume == "-":
        job = make_job(load_sequence(sequence_path), store_path, station)
    else:
        job = make_resumed_job(resume, store_path, station)
    outcome = run_on_station(
        job,
        clock=ScaledClock(float(speed)),
        observers=[Teller()],
        silence_s=float(silence[0]) if silence else None,
    )
    say("outcome", outcome.status, outcome.safe.verified, outcome.reason)


if __name__ == "__main__":
    main()
