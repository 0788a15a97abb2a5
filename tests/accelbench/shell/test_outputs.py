"""Places are proved writable before anything is begun, and left as they were."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from accelbench.shell.outputs import check_report, checked_output, prove_writable
from errormodel.errors import InputError
from tests.accelbench.commands.run.display_process import ENVIRONMENT

MINI = Path(__file__).parents[1] / "mini.toml"
PROVE = """
import os, resource, sys
from pathlib import Path
from errormodel.errors import InputError
from accelbench.shell.outputs import prove_writable
if sys.argv[2] == "nobody":
    os.setuid(65534)
else:
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
try:
    prove_writable(Path(sys.argv[1]))
except InputError as err:
    print(err)
"""


@pytest.mark.parametrize("name", ["x.csv", "made/for/it/x.csv"])
def test_a_place_that_can_be_written_is_left_as_it_was(tmp_path, name):
    prove_writable(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_exists_keeps_what_is_in_it(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("mine")
    checked_output(path, [], force=True)
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "path",
    [
        "/proc/x.csv",
        "/proc/made/for/it/x.csv",
        "{tmp}/" + 250 * "n" + ".csv",  # too long while it is written: it has a draft's name then
        "{tmp}/file/x.csv",
        "/dev/full",
    ],
)
def test_a_place_that_cannot_be_written_is_refused(tmp_path, path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"cannot be written|is not a file"):
        prove_writable(Path(path.format(tmp=tmp_path)))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_folder_or_a_file_of_somebody_else_is_refused(tmp_path, existing):
    place = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else tmp_path
    folder = place / f"accelbench-{os.getpid()}"
    folder.mkdir(mode=0o755)
    try:
        path = folder / "x.csv"
        if existing:
            folder.chmod(0o777)
            path.write_text("mine")
        assert "Permission denied" in proved(path, "nobody")
    finally:
        for one in folder.iterdir():
            one.unlink()
        folder.rmdir()


def test_a_disk_that_takes_no_more_is_refused(tmp_path):
    # a limit on the size of files stands for it: an empty file can still be made
    assert "File too large" in proved(tmp_path / "x.csv", "limited")
    assert list(tmp_path.iterdir()) == []


def proved(path: Path, how: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", PROVE, str(path), how],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def test_a_report_goes_into_a_folder_that_is_made_or_into_none(tmp_path):
    check_report(tmp_path / "a/b", force=False)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="cannot be written"):
        check_report(Path("/proc/report"), force=False)


@pytest.mark.parametrize("option", ["--out", "--store"])
def test_a_test_is_not_begun_when_its_result_has_nowhere_to_go(refused, tmp_path, option):
    own = ("--store", tmp_path / "s.sqlite") if option == "--out" else ()
    said = refused("run", MINI, option, "/proc/x.csv", *own)
    assert "/proc/x.csv: cannot be written" in said


@pytest.mark.parametrize("option", ["--out", "--report"])
def test_nothing_is_computed_for_a_place_that_cannot_be_written(
    refused, two_runs, monkeypatch, option
):
    monkeypatch.setattr(
        "accelbench.commands.fit.work.fit_runs", lambda *_, **__: pytest.fail("fitted")
    )
    assert "cannot be written" in refused("fit", two_runs, option, "/proc/x")
