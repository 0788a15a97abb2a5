"""Times of other people's logs: days, zones, changes of clocks, units that cannot be."""

import datetime as dt
import logging
from pathlib import Path

import numpy as np
import pytest

from errormodel.errors import InputError
from tests.thermo.recording.foreign.sample_log import changed, run
from thermo.recording.files import RecordedRuns, read_runs, write_runs

BERLIN = 'format = "%d.%m.%Y %H:%M:%S"\nzone = "Europe/Berlin"'
NIGHT = 'format = "%d.%m.%Y %H:%M:%S"'


def log_of(times: list[str]) -> str:
    return "t,T,u\n" + "".join(f"{t},20,{k}\n" for k, t in enumerate(times))


def every_20_minutes(day: str, hours: list[str]) -> list[str]:
    return [f"{day} {hour}:{minute:02d}:00" for hour in hours for minute in (0, 20, 40)]


@pytest.mark.parametrize(
    ("day", "hours", "began"),
    [
        # the hour from 2 comes twice in autumn, and not at all in spring
        ("25.10.2026", ["01", "02", "02", "03"], dt.datetime(2026, 10, 24, 23, tzinfo=dt.UTC)),
        ("29.03.2026", ["00", "01", "03", "04"], dt.datetime(2026, 3, 28, 23, tzinfo=dt.UTC)),
    ],
    ids=["autumn", "spring"],
)
def test_a_zone_places_rows_on_both_sides_of_a_change_of_clocks(tmp_path, day, hours, began):
    record = run(tmp_path, log_of(every_20_minutes(day, hours)), changed(('unit = "s"', BERLIN)))
    np.testing.assert_array_equal(record.time_s, 1200.0 * np.arange(12))
    assert record.run_start_utc == {"1": began}


def test_without_a_zone_a_change_of_clocks_is_refused_with_the_guess(tmp_path, caplog):
    log = log_of(every_20_minutes("25.10.2026", ["01", "02", "02", "03"]))
    log = log.replace("02:40:00,20,5", "02:58:00,20,5")  # 58 min back in the next row
    with pytest.raises(InputError, match=r"is not after .* were the clocks changed\? give zone"):
        run(tmp_path, log, changed(('unit = "s"', NIGHT)))
    mapping = 'on_bad_row = "flag"\n' + changed(('unit = "s"', NIGHT))
    with caplog.at_level(logging.WARNING):
        run(tmp_path, log, mapping)
    assert "the time goes back by an hour: were the clocks changed?" in caplog.text


def test_a_zone_that_there_is_not_is_refused(tmp_path):
    with pytest.raises(InputError, match="no time zone 'Europe/Berln', expected one like"):
        run(tmp_path, log_of(["0"]), changed(('unit = "s"', BERLIN.replace("lin", "ln"))))


def test_date_and_time_in_columns_of_their_own(tmp_path):
    log = "day,t,T,u\n31.12.2025,23:59:59,20,1\n01.01.2026,00:00:00.5,21,2\n"
    how = 'date = "day"\nformat = "%d.%m.%Y %H:%M:%S.%f"'
    record = run(tmp_path, log.replace("59:59", "59:59.0"), changed(('unit = "s"', how)))
    np.testing.assert_array_equal(record.time_s, [0.0, 1.5])
    with pytest.raises(InputError, match="date and zone go with format only"):
        run(tmp_path, log, changed(('unit = "s"', 'unit = "s"\ndate = "day"')))


def test_times_of_day_count_on_over_midnight(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        record = run(
            tmp_path, log_of(["23:59:58", "23:59:59", "00:00:00", "00:00:02"]),
            changed(('unit = "s"', 'format = "%H:%M:%S"')),
        )  # fmt: skip
    np.testing.assert_array_equal(record.time_s, [0.0, 1.0, 2.0, 4.0])
    assert "the time of day passed midnight 1 times (line 4 …)" in caplog.text
    assert record.run_start_utc == {}


@pytest.mark.parametrize(
    ("bits", "times", "seconds"),
    [
        (16, [65_534, 65_535, 0, 2], [0, 1, 2, 4]),
        (8, [250, 254, 2, 6, 250, 254, 2], [0, 4, 8, 12, 256, 260, 264]),
    ],
)
def test_a_counter_that_wraps_counts_on(tmp_path, bits, times, seconds):
    mapping = changed(('unit = "s"', f'unit = "s"\nwrap_bits = {bits}'))
    record = run(tmp_path, log_of([str(t) for t in times]), mapping)
    np.testing.assert_array_equal(record.time_s, seconds)


def test_one_wrong_stamp_costs_one_row(tmp_path, caplog):
    times = [str(t) for t in range(10)]
    times[4] = "1000000"
    mapping = 'on_bad_row = "flag"\n' + changed()
    with caplog.at_level(logging.WARNING):
        record = run(tmp_path, log_of(times), mapping)
    np.testing.assert_array_equal(record.time_s, [0, 1, 2, 3, 5, 6, 7, 8, 9])
    assert "1 rows left out, time missing or out of order: line 6 ('1000000')" in caplog.text


@pytest.mark.parametrize(
    ("per_second", "words"), [(1e3, "in ms"), (1e6, "in µs")], ids=["ms", "µs"]
)
def test_times_in_other_units_are_told_at_import_and_refused(tmp_path, caplog, per_second, words):
    times = [str(round(per_second * t)) for t in range(30)]
    with caplog.at_level(logging.WARNING):
        record: RecordedRuns = run(tmp_path, log_of(times), changed())
    assert words in caplog.text
    path: Path = tmp_path / "run.csv"
    write_runs(record, path)
    with pytest.raises(InputError, match=words):
        read_runs([path])
