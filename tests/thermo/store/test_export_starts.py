"""When the runs of a stored test began, by the wall and by the station's clock."""

from thermo.store.export import run_starts
from thermo.store.records import RunRecord


def run(number: int, utc: str, clock_s: float | None) -> RunRecord:
    return RunRecord(number=number, start_utc=utc, start_clock_s=clock_s, status="finished")


def seconds_between(*runs: RunRecord) -> float:
    starts = run_starts(runs)
    return (starts[2] - starts[1]).total_seconds()


def test_an_emulated_clock_runs_ahead_of_the_wall() -> None:
    one, two = "2026-03-02T18:00:00+00:00", "2026-03-02T18:00:09+00:00"
    assert seconds_between(run(1, one, 0.0), run(2, two, 36000.0)) == 36000.0


def test_a_clock_that_began_anew_or_is_not_known_leaves_it_to_the_wall() -> None:
    one, two = "2026-03-02T18:00:00+00:00", "2026-03-03T02:00:00+00:00"
    assert seconds_between(run(1, one, 9e5), run(2, two, 60.0)) == 28800.0
    assert seconds_between(run(1, one, None), run(2, two, None)) == 28800.0
