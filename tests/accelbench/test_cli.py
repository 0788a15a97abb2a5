import json
import os
import subprocess
import sys
from typing import get_args

import click
import pytest

from accelbench import cli
from accelbench.cli import COMMANDS, main
from accelbench.start import THREADS, take_one_thread


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_takes_json_and_explains_itself(call, command):
    done = call(command, "--help")
    assert done.code == 0
    assert "--json" in done.out
    assert done.err == ""


def test_help_lists_every_command_without_importing_it():
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys; from accelbench.cli import main; main(['--help']);"
            "sys.exit('pandas' in sys.modules)",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert all(f"  {name} " in done.stdout for name in COMMANDS)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nonsense"], "nonsense"),
        (["fit"], "RUN.csv"),
        (["fit", "a.csv", "--nonsense"], "--nonsense"),
        (["compensate", "a.csv", "--out", "b.csv"], "--model"),
        (["run"], "SEQUENCE.toml"),
        (["run", "a.toml", "--speed", "0"], "--speed"),
        (["emulate", "a.toml", "--speed", "fast"], "fast"),
        (["import", "log.txt"], "--map"),
        (["export"], "ID"),
    ],
)
def test_misuse_is_one_line_and_exit_code_2(refused, arguments, said):
    assert said in refused(*arguments)


def test_no_command_at_all_shows_the_help(call):
    done = call()
    assert done.code == 2
    assert "Usage" in done.out
    assert done.err.count("\n") == 1


@pytest.mark.parametrize("command", ["fit", "compensate", "import", "run", "emulate", "runs"])
def test_a_file_that_is_not_there_is_named(refused, tmp_path, command):
    missing = tmp_path / "missing.csv"
    options = {
        "compensate": ["--model", tmp_path / "m.json", "--out", tmp_path / "o.csv"],
        "import": ["--map", tmp_path / "m.toml", "--out", tmp_path / "o.csv"],
    }
    arguments = ["--store", missing] if command == "runs" else [missing]
    said = refused(command, *arguments, *options.get(command, []))
    assert str(tmp_path) in said


def test_what_goes_wrong_inside_is_one_line_and_shown_in_full_when_asked(
    call, monkeypatch, two_runs
):
    def broken(*_args: object, **_kwargs: object) -> None:
        raise ZeroDivisionError("a test\nof two lines")

    monkeypatch.setattr("accelbench.commands.fit.work.fit_runs", broken)
    done = call("fit", two_runs)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "error of the program: ZeroDivisionError: a test of two lines" in done.err
    monkeypatch.setenv("ACCELBENCH_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        main(["fit", str(two_runs)])


@pytest.mark.parametrize(
    ("raised", "code"), [(KeyboardInterrupt(), 130), (OSError(28, "No space left", "x.csv"), 2)]
)
def test_other_ends(call, monkeypatch, two_runs, raised, code):
    def ends(*_args: object, **_kwargs: object) -> None:
        raise raised

    monkeypatch.setattr("accelbench.commands.fit.work.fit_runs", ends)
    done = call("fit", two_runs)
    assert done.code == code
    said = [line for line in done.err.splitlines() if not line.startswith("accelbench: warning")]
    assert len(said) == 1


def test_warnings_come_after_a_success_and_not_beside_an_error(call, two_runs):
    header, rest = two_runs.read_text().split("\n", 1)
    two_runs.write_text(header + ",humidity\n" + rest.replace("\n", ",40\n"))
    done = call("fit", two_runs, "--json")
    assert done.code == 0
    assert "humidity" in done.err
    assert json.loads(done.out)
    assert call("fit", two_runs, "--holdout", "nobody").err.count("\n") == 1


def test_a_pipe_that_breaks_inside_is_no_reader_that_left(call, monkeypatch, two_runs):
    """What becomes of a standard stream's reader is in test_display.py and test_terminal.py."""

    def broken(*_args: object, **_kwargs: object) -> None:
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr("accelbench.commands.fit.work.read_with_doubts", broken)
    done = call("fit", two_runs)
    assert (done.code, done.err) == (2, "accelbench: pipe: Broken pipe\n")


def test_the_program_itself_runs_and_gives_its_exit_code(two_runs):
    program = [
        sys.executable,
        "-c",
        "import sys; from accelbench.cli import main; sys.exit(main())",
    ]
    good = subprocess.run(
        [*program, "fit", str(two_runs), "--json"], capture_output=True, text=True, check=False
    )
    assert good.returncode == 0
    assert len(json.loads(good.stdout)["accelerometers"]) == 2
    bad = subprocess.run([*program, "nonsense"], capture_output=True, text=True, check=False)
    assert (bad.returncode, bad.stdout) == (2, "")
    assert bad.stderr.count("\n") == 1


def test_the_table_of_commands_is_true():
    context = click.Context(cli.accelbench)
    for name in COMMANDS:
        command = cli.accelbench.get_command(context, name)
        assert command is not None
        assert command.name == name


def test_a_help_imports_none_of_the_libraries_that_take_their_second():
    program = (
        "import sys\n"
        "import click\n"
        "from accelbench.cli import accelbench\n"
        "from accelbench.commands.discrepancy.group import discrepancy\n"
        "from accelbench.commands.rig.group import rig\n"
        "for group in (accelbench, discrepancy, rig):\n"
        "    with click.Context(group) as context:\n"
        "        for name in group.list_commands(context):\n"
        "            assert group.get_command(context, name).get_help(context)\n"
        "heavy = {'numpy', 'scipy', 'pandas', 'pyarrow', 'matplotlib', 'sqlalchemy', 'numba'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "[]\n"), done.stderr


def test_what_a_help_says_of_a_default_is_what_the_work_takes():
    from accelbench.commands.rig_triad import command as triad
    from accelbench.commands.run_in import command as runin
    from sinscal.triad.rests import Unit
    from thermo.run_in.judge import WINDOW

    assert runin.WINDOW == WINDOW
    assert get_args(Unit) == triad.UNITS


@pytest.mark.parametrize(
    ("words", "said"),
    [("accelbench rig cal", "calibrate"), ("accelbench stability --li", "limits")],
)
def test_the_shell_s_completion_is_answered(words, said):
    asked = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    done = subprocess.run(
        [sys.executable, "-m", "accelbench"],
        env=os.environ | {"_ACCELBENCH_COMPLETE": "bash_complete"} | asked,
        capture_output=True,
        text=True,
        check=False,
    )
    assert said in done.stdout, done.stderr


def test_a_refusal_with_json_is_a_document_too(call):
    done = call("fit", "lost.csv", "--json")
    assert done.code == 2
    assert done.document == {"error": "lost.csv: no such file", "exit_code": 2}
    assert done.err == "accelbench: lost.csv: no such file\n"


@pytest.mark.parametrize(("words", "meant"), [(("ft",), "fit"), (("rig", "calibrte"), "calibrate")])
def test_a_misspelt_command_is_told_the_nearest(refused, words, meant):
    assert f"did you mean '{meant}'?" in refused(*words)
    assert "expected one of demo, run" in refused("zzzzzz")


@pytest.mark.parametrize(("told", "expected"), [({}, "1"), ({"OMP_NUM_THREADS": "3"}, None)])
def test_matrices_take_one_thread_unless_the_user_says_how_many(monkeypatch, told, expected):
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    for name, value in told.items():
        monkeypatch.setenv(name, value)
    take_one_thread()
    assert os.environ.get("OPENBLAS_NUM_THREADS") == expected
    assert os.environ["OMP_NUM_THREADS"] == told.get("OMP_NUM_THREADS", "1")
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize("folder", [".", "/"])
@pytest.mark.parametrize(
    "arguments",
    [
        ("fit", "{}"),
        ("rig", "calibrate", "{}"),
        ("rig", "triad", "{}"),
        ("discrepancy", "thermal", "{}"),
        ("export", "1", "--store", "{}", "--out", "x.csv"),
        ("runs", "--store", "{}"),
        ("control", "list", "--store", "{}"),
    ],
    ids=" ".join,
)
def test_a_folder_without_a_name_is_told_to_be_one(refused, arguments, folder):
    said = refused(*(word.format(folder) for word in arguments))
    assert "it is a folder, expected a file" in said
