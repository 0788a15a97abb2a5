from pathlib import Path

import pytest

from errormodel.errors import InputError
from errormodel.io.atomic import replace_file, write_files, written_together


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_files_appear_together(tmp_path):
    write_files([(tmp_path / "a/x", b"1"), (tmp_path / "b/y", b"2")])
    assert (tmp_path / "a/x").read_bytes() == b"1"
    assert (tmp_path / "b/y").read_bytes() == b"2"
    assert names(tmp_path / "a") == ["x"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OSError])
def test_nothing_is_left_when_writing_fails_in_the_middle(tmp_path, error):
    (tmp_path / "x").write_bytes(b"old")

    def fail() -> None:
        with written_together([tmp_path / "x", tmp_path / "y"]) as (x, _):
            x.write_bytes(b"new")
            raise error("in the middle")

    with pytest.raises(InputError if error is OSError else error):
        fail()
    assert names(tmp_path) == ["x"]
    assert (tmp_path / "x").read_bytes() == b"old"


def test_the_complaint_names_the_file_meant_and_not_the_draft(tmp_path):
    with (
        pytest.raises(InputError, match=r"nowhere/x: cannot be written: No such file"),
        written_together([tmp_path / "nowhere/x"]) as (draft,),
    ):
        draft.write_bytes(b"1")


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="file: cannot be made"):
        write_files([(tmp_path / "file/x", b"1")])


def test_a_file_is_replaced_whole_or_stays_as_it_was(tmp_path, monkeypatch):
    replace_file(tmp_path / "x", b"old")

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr("errormodel.io.atomic.os.fsync", refuse)
        with pytest.raises(OSError, match="No space left"):
            replace_file(tmp_path / "x", b"new")
    assert (tmp_path / "x").read_bytes() == b"old"
    replace_file(tmp_path / "x", b"new")
    assert (tmp_path / "x").read_bytes() == b"new"
    assert names(tmp_path) == ["x"]
