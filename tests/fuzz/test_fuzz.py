"""Whatever is done to a file: it is read, or refused in one line that names file and place."""

import logging
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from fuzz_mutate import mutate
from fuzz_targets import TARGETS, Target

from errormodel.errors import InputError

PER_TARGET = 60  # some 700 in all in a normal run
ALL_TOGETHER = 2_100


@pytest.fixture(autouse=True)
def _no_log(monkeypatch):
    """A failure's report would drown in the warnings about unknown columns."""
    monkeypatch.setattr(logging.getLogger("errormodel.io.tables"), "disabled", True)
    monkeypatch.setattr(logging.getLogger("thermo.recording.foreign.read"), "disabled", True)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def faults(target: Target, folder: Path, count: int) -> Iterator[str]:
    """Yield what went wrong, one text for each mutated file that was not treated as promised."""
    for name, text in target.files.items():
        (folder / name).write_bytes(text)
    first = zlib.crc32(target.name.encode())
    for seed in range(first, first + count):
        damaged, how = mutate(target.files[target.damaged], seed)
        (folder / target.damaged).write_bytes(damaged)
        before = contents(folder)
        problem = ""
        try:
            target.call(folder)
        except InputError as err:
            text = str(err)
            if "\n" in text or "\r" in text or len(text) > 1000:
                problem = f"not one line: {text!r:.200}"
            elif not any(text.startswith(str(folder / name)) for name in target.files):
                problem = f"names no file: {text:.200}"
            elif not err.problem:
                problem = f"names no problem: {text:.200}"
        except Exception as err:
            problem = f"{type(err).__name__}: {err!s:.200}"
        if contents(folder) != before:
            problem += " something was written"
        if problem:
            yield f"{target.name}, seed {seed} ({how}): {problem}"


@pytest.mark.parametrize("target", TARGETS, ids=lambda t: t.name)
def test_a_sound_file_is_read(target, tmp_path):
    for name, text in target.files.items():
        (tmp_path / name).write_bytes(text)
    target.call(tmp_path)


@pytest.mark.parametrize("target", TARGETS, ids=lambda t: t.name)
def test_mutated_files(target, tmp_path):
    assert list(faults(target, tmp_path, PER_TARGET // target.cost)) == []


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS, ids=lambda t: t.name)
def test_two_thousand_mutated_files(target, tmp_path):
    assert list(faults(target, tmp_path, -(-ALL_TOGETHER // len(TARGETS)))) == []


def test_the_mutations_do_damage(tmp_path):
    """A fuzz that only ever gets sound files, or only hopeless ones, would find nothing."""
    target = TARGETS[0]
    read = refused = 0
    for seed in range(150):
        for name, text in target.files.items():
            (tmp_path / name).write_bytes(text)
        (tmp_path / target.damaged).write_bytes(mutate(target.files[target.damaged], seed)[0])
        try:
            target.call(tmp_path)
            read += 1
        except InputError:
            refused += 1
    assert read > 10
    assert refused > 50


def test_the_same_seed_gives_the_same_file():
    text = TARGETS[0].files["run.csv"]
    assert [mutate(text, s) for s in range(50)] == [mutate(text, s) for s in range(50)]
    assert len({mutate(text, s)[0] for s in range(50)}) > 40
