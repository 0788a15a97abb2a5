"""One row in a hundred spoiled changes no verdict: readings are checked first."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.thermo.discrepancy.examples import NOMINAL, QUICK, hidden_runs
from thermo.discrepancy.find import find_discrepancy
from thermo.library.effects import ThermalEffect
from thermo.recording.files import read_runs, write_runs

Spoil = Callable[[pd.DataFrame, np.random.Generator, np.ndarray], None]
SHARE = 0.01
FEWER = 80  # simulated nulls: the effect is far beyond luck


def cold(frame: pd.DataFrame, rng: np.random.Generator, rows: np.ndarray) -> None:
    """A dead thermistor."""
    frame.loc[rows, "temp_c"] = -127.0


def warm(frame: pd.DataFrame, rng: np.random.Generator, rows: np.ndarray) -> None:
    frame.loc[rows, "temp_c"] += 5.0


def overload(frame: pd.DataFrame, rng: np.random.Generator, rows: np.ndarray) -> None:
    """As the station records it: a huge number, flagged."""
    frame.loc[rows, "output"] = 9.9e37
    frame["flag"] = np.where(frame.index.isin(rows), "overload", "")


def zero(frame: pd.DataFrame, rng: np.random.Generator, rows: np.ndarray) -> None:
    frame.loc[rows, "output"] = 0.0


def burst(frame: pd.DataFrame, rng: np.random.Generator, rows: np.ndarray) -> None:
    """Six readings in a row that are 1 mg off either way, two hundred sigmas."""
    begun = rng.choice(len(frame) - 6, rows.size // 6, replace=False)
    hit = np.unique(begun[:, None] + np.arange(6))
    frame.loc[hit, "output"] += 1e-3 * NOMINAL * rng.choice([-1.0, 1.0], hit.size)


KINDS: Mapping[str, Spoil] = {f.__name__: f for f in (cold, warm, overload, zero, burst)}


@cache
def clean(hidden: str) -> pd.DataFrame:
    sizes = {"loop": 20.0} if hidden else {}
    return hidden_runs(1, sizes, rates=(2.0, 2.0), every_45=True).frame().reset_index(drop=True)


def verdict(
    frame: pd.DataFrame, folder: Path, effects: Sequence[ThermalEffect] | None = None
) -> tuple[str, list[str], list[tuple[str, ...]]]:
    """Return what is said of the file that the readings make."""
    path = folder / "runs.csv"
    write_runs(hidden_runs(1, rates=(2.0,)), path)  # for its sidecar
    frame.to_csv(path, index=False)
    (d,) = find_discrepancy(read_runs([path]), effects=effects, draws=FEWER)
    return d.verdict, [e.name for e in d.effects], list(d.alias_sets)


def spoiled(hidden: str, kind: str, seed: int) -> pd.DataFrame:
    frame, rng = clean(hidden).copy(), np.random.default_rng(seed)
    rows = rng.choice(len(frame), int(SHARE * len(frame)), replace=False)
    KINDS[kind](frame, rng, rows)
    return frame


@pytest.mark.parametrize(
    "kind", ["burst", *(pytest.param(k, marks=pytest.mark.slow) for k in KINDS if k != "burst")]
)
def test_spoiled_rows_hide_no_effect(kind: str, tmp_path: Path) -> None:
    assert verdict(spoiled("loop", kind, 1), tmp_path, QUICK) == ("named", ["bias_hysteresis"], [])


@pytest.mark.parametrize("kind", ["warm", pytest.param("burst", marks=pytest.mark.slow)])
def test_spoiled_rows_make_no_effect(kind: str, tmp_path: Path) -> None:
    assert verdict(spoiled("", kind, 2), tmp_path, QUICK) == ("nothing", [], [])


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_no_verdict_changes_over_twenty_seeds(kind: str, tmp_path: Path) -> None:
    for seed in range(10, 20):
        for hidden in ("loop", ""):
            said = verdict(spoiled(hidden, kind, seed), tmp_path)
            assert said == verdict(clean(hidden), tmp_path), (seed, hidden)
