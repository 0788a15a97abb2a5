import pytest

from accelbench.shell.advice import advice


@pytest.mark.parametrize(
    ("name", "text", "command", "helps"),
    [
        ("a.csv", "run;serial;time_s\nr;A;0,5\n", "fit", "file.delimiter"),
        ("a.csv", "run,serial,time_s\nr,A,2026-01-01T00:00:00\n", "fit", "time.format"),
        ("a.csv", "run,serial,time_s\nr,A,0.5\n", "fit", ""),
        ("a.csv", "run;serial\n", "import", ""),
        ("a.toml", "latitude_deg = 55\n", "fit", "rig calibrate"),
        ("a.toml", 'output_unit = "mA"\n', "rig", "accelbench fit"),
        ("a.toml", 'output_unit = "mA"\n', "fit", ""),
        ("a.toml", "no = toml = at all\n", "fit", ""),
    ],
)
def test_the_command_that_helps_is_named(tmp_path, name, text, command, helps):
    path = tmp_path / name
    path.write_text(text)
    said = advice(str(path), [command])
    assert helps in said
    assert bool(said) == bool(helps)


def test_a_folder_is_called_one_and_what_is_no_file_gets_no_advice(tmp_path):
    assert advice(str(tmp_path), ["fit"]) == "it is a folder, expected a file"
    assert advice(str(tmp_path / "lost.csv"), ["fit"]) == ""
    assert advice("options", ["fit"]) == ""
