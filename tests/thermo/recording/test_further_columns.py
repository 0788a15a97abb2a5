"""Columns that no library declares: which a residual is held against, and why not others."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from thermo.recording.channel import channel_of
from thermo.recording.files import read_runs
from thermo.recording.further_columns import MOST_COLUMNS, further_columns

ROWS = 40
SIDECAR = 'output_unit = "g"\ngravity_m_s2 = 9.8\nnominal_scale = 1.0\n'


def table(**more: object) -> pd.DataFrame:
    rng = np.random.default_rng(1)
    k = np.arange(ROWS)
    return pd.DataFrame(
        {
            "run": np.where(k < ROWS // 2, "1", "2"),
            "serial": "A",
            "time_s": k % (ROWS // 2) * 10.0,
            "temp_c": 20.0 + rng.standard_normal(ROWS),
            "position_deg": 90.0 * (k % 4),
            "output": np.sin(np.pi / 2 * (k % 4)) + 1e-5 * rng.standard_normal(ROWS),
            "supply_v": 15.0 + rng.standard_normal(ROWS),
            **more,
        }
    )


def written(path: Path, frame: pd.DataFrame) -> Path:
    path.with_suffix(".toml").write_text(SIDECAR)
    if path.suffix == ".parquet":
        frame.to_parquet(path)
    else:
        frame.to_csv(path, index=False)
    return path


@pytest.mark.parametrize("name", ["runs.csv", "runs.parquet"])
def test_a_complete_column_of_numbers_is_a_signal_of_the_channel(name: str, tmp_path: Path) -> None:
    path = written(tmp_path / name, table())
    assert [one.name for one in further_columns([path])] == ["supply_v"]
    plain, more = read_runs([path]), read_runs([path], more_columns=True)
    assert set(more.more) - set(plain.more) == {"supply_v"}
    assert plain.digest("1") == more.digest("1")
    # it is a signal after the reading, too, when nothing declares it any more
    channel = channel_of(more, "A")
    assert np.array_equal(channel.record["supply_v"], more.more["supply_v"][more.good])


@pytest.mark.parametrize(
    ("column", "reason"),
    [
        (["Ann"] * ROWS, "more than numbers"),
        ([1.0, np.nan] * (ROWS // 2), "no value of it"),
        (np.arange(ROWS), "does not rise and fall"),
        ([1.0] * (ROWS // 2) + [2.0] * (ROWS // 2), "does not rise and fall"),
        (1000.0 * table()["output"] + 3.0, "the output over again"),
    ],
)
def test_what_is_no_condition_of_a_reading_is_left_out_with_its_reason(
    column: object, reason: str, tmp_path: Path
) -> None:
    told: list[str] = []
    path = written(tmp_path / "runs.csv", table(other=column))
    assert [one.name for one in further_columns([path], told.append)] == ["supply_v"]
    assert any(line.startswith("column other") and reason in line for line in told)


def test_names_of_the_program_and_what_is_no_name_are_not_looked_at(tmp_path: Path) -> None:
    noise = np.random.default_rng(2).standard_normal((4, ROWS))
    names = ("slot", "accel_compensated_g", "x_c", "supply 2")
    path = written(tmp_path / "runs.csv", table(**dict(zip(names, noise, strict=True))))
    assert [one.name for one in further_columns([path])] == ["supply_v"]


def test_a_value_may_be_missing_where_the_reading_is_flagged(tmp_path: Path) -> None:
    frame = table(flag="")
    frame.loc[3, ["supply_v", "flag"]] = [np.nan, "gap"]
    path = written(tmp_path / "runs.csv", frame)
    assert [one.name for one in further_columns([path])] == ["supply_v"]


def test_a_column_must_be_in_every_file_and_there_are_a_few_at_most(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).standard_normal((MOST_COLUMNS, ROWS))
    many = {f"u{k}": row for k, row in enumerate(noise)}
    one, two = written(tmp_path / "1.csv", table(**many)), written(tmp_path / "2.csv", table())
    told: list[str] = []
    assert len(further_columns([one], told.append)) == MOST_COLUMNS
    assert any("declare it by --library" in line for line in told)
    assert [s.name for s in further_columns([one, two])] == ["supply_v"]
