"""The guardian's word is kept: with a full disk, through a torn write, for whoever comes next."""

import json
import os
import resource
import signal
from pathlib import Path

import pytest

from thermo.safety.guardian_record import SLOT_BYTES, RecordFile, read_record
from thermo.safety.guardian_results import pending_results, result_file

FIXED = {"test_id": "T1", "chamber": "modbus+tcp://h:502", "safe_temp_c": 25.0}


def test_the_newest_entry_is_the_one_that_is_read(tmp_path: Path) -> None:
    path = tmp_path / "g.json"
    record = RecordFile(path, FIXED)
    watching = read_record(path)
    assert watching is not None
    assert (watching.phase, watching.alive, watching.needs_help) == ("watching", True, False)
    for attempt in range(5):
        record.write("trying", why="gone", steps=(f"attempt {attempt}",))
        read = read_record(path)
        assert read is not None
        assert read.test_id == "T1"
        assert f"attempt {attempt}" in read.text
        assert read.needs_help
    record.write("safe", why="gone", verified=True, steps=("held",))
    read = read_record(path)
    assert read is not None
    assert (read.phase, read.verified, read.needs_help) == ("safe", True, False)


def test_a_torn_write_leaves_the_entry_before(tmp_path: Path) -> None:
    path = tmp_path / "g.json"
    record = RecordFile(path, FIXED)
    record.write("taking over", why="silent")
    record.write("trying", why="silent", steps=("refused",))
    whole = path.read_bytes()
    (newest,) = [k for k in (0, SLOT_BYTES) if b'"trying"' in whole[k : k + SLOT_BYTES]]
    for cut in (1, 20, 100, 200):
        torn = bytearray(whole)
        torn[newest + cut : newest + SLOT_BYTES] = b" " * (SLOT_BYTES - cut)
        path.write_bytes(torn)
        read = read_record(path)
        assert read is not None
        assert read.phase == "taking over"
    changed = whole.replace(b'"trying"', b'"flying"')  # well-formed, and not what was written
    path.write_bytes(changed)
    read = read_record(path)
    assert read is not None
    assert read.phase == "taking over"


def test_the_longest_result_fits_into_its_slot(tmp_path: Path) -> None:
    path = tmp_path / "g.json"
    record = RecordFile(path, FIXED)
    record.write("trying", why="é" * 3000, steps=tuple("°" * 2000 for _ in range(50)))
    assert path.stat().st_size == 2 * SLOT_BYTES
    read = read_record(path)
    assert read is not None
    assert read.phase == "trying"


def test_a_disk_without_room_loses_no_word(tmp_path: Path) -> None:
    """Nothing is written beyond the file's first size, which a limit on file size enforces."""
    path = tmp_path / "g.json"
    record = RecordFile(path, FIXED)
    blocks = path.stat().st_blocks
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2 * SLOT_BYTES, hard))
        with pytest.raises(OSError, match="too large"):
            (tmp_path / "other").write_bytes(b"x" * (3 * SLOT_BYTES))
        for k in range(20):
            record.write("trying", why="gone", steps=(f"attempt {k}",))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert path.stat().st_blocks == blocks
    read = read_record(path)
    assert read is not None
    assert "attempt 19" in read.text


def test_a_guardian_that_died_watching_is_told_as_no_protection(tmp_path: Path) -> None:
    path = tmp_path / "g.json"
    child = os.fork()
    if child == 0:
        RecordFile(path, FIXED)
        os._exit(0)
    os.waitpid(child, 0)
    read = read_record(path)
    assert read is not None
    assert not read.alive
    assert read.needs_help
    assert "the chamber has not been made safe" in read.text


@pytest.mark.parametrize("text", ["", "{torn", "[]", "17", '{"why": 1}', "\0" * 9000])
def test_a_damaged_file_is_told_and_needs_help(tmp_path: Path, text: str) -> None:
    path = tmp_path / "g.json"
    path.write_text(text, encoding="utf-8")
    read = read_record(path, "T2")
    assert read is not None
    assert read.test_id == "T2"
    assert read.needs_help
    assert "damaged" in read.text


@pytest.mark.parametrize("on_server", [False, True])
def test_what_is_pending_is_found_for_a_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, on_server: bool
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    url = "postgresql://u@h/db" if on_server else str(tmp_path / "night.sqlite")
    assert pending_results(url) == ()
    RecordFile(result_file(url, "T1"), FIXED)  # of a healthy running test
    left = RecordFile(result_file(url, "T3"), FIXED | {"test_id": "T3"})
    left.write("trying", why="gone", steps=("no answer",))
    done = RecordFile(result_file(url, "T2"), FIXED | {"test_id": "T2"})
    done.write("safe", why="gone", verified=True)
    RecordFile(result_file(tmp_path / "other.sqlite", "T4"), FIXED).write("safe", why="")
    assert [(r.test_id, r.needs_help) for r in pending_results(url)] == [
        ("T2", False),
        ("T3", True),
    ]


def test_every_entry_is_a_line_of_json(tmp_path: Path) -> None:
    path = tmp_path / "g.json"
    RecordFile(path, FIXED).write("safe", why="gone", verified=True, steps=("held at 25 °C",))
    entries = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    assert [e["sequence"] for e in sorted(entries, key=lambda e: e["sequence"])] == [1, 2]
