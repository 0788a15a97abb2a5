"""The Python entrance: lazy, whole, with a twin in every help, and the tutorial that uses it."""

import importlib
import re
import runpy
import subprocess
import sys
from pathlib import Path

import click
import pytest

import accelbench as ab
from accelbench.cli import accelbench as commands
from accelbench.start import foreign_packages

ROOT = Path(__file__).parents[1]


def leaves(command: click.Command, name: str) -> list[tuple[str, click.Command]]:
    if not isinstance(command, click.Group):
        return [(name, command)]
    context = click.Context(command)
    parts = [(n, command.get_command(context, n)) for n in command.list_commands(context)]
    return [leaf for n, part in parts if part for leaf in leaves(part, f"{name} {n}".strip())]


@pytest.mark.parametrize("module", ["accelbench", "accelbench.rig"])
def test_every_name_of_the_entrance_is_there_with_a_docstring(module: str) -> None:
    entrance = importlib.import_module(module)
    for name in entrance.__all__:
        assert getattr(entrance, name).__doc__, name
    assert set(entrance.__all__) <= set(dir(entrance))
    with pytest.raises(AttributeError, match="no attribute 'nothing_of_the_kind'"):
        entrance.nothing_of_the_kind  # noqa: B018


def test_nothing_is_imported_before_it_is_asked_for() -> None:
    code = "import sys, accelbench; print(sorted({'numpy', 'pandas', 'click'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_help_names_its_twin_in_python() -> None:
    lost = []
    for name, command in leaves(commands, ""):
        text = " ".join((command.help or "").split())
        if "In Python: " not in text:
            lost.append(name)
            continue
        places = re.findall(r"In Python: ((?:[\w.]+, )*[\w.]+)\.(?: |$)", text)
        assert places or "importlib" in text, name
        for place in ", ".join(places).split(", ") if places else []:
            module, _, attribute = place.rpartition(".")
            assert callable(getattr(importlib.import_module(module), attribute)), place
    assert lost == []


def test_the_tutorial_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tutorial = runpy.run_path(str(ROOT / "docs/tutorial/from-python.py"))
    figures = tutorial["main"](tmp_path)
    assert figures["coefficients"] > 10
    assert figures["pictures"] > 3
    assert "temperature model of QA-001" in capsys.readouterr().out
    assert len(list(tmp_path.glob("*.png"))) == figures["pictures"]


def test_a_rig_programme_is_analysed_from_python() -> None:
    programme = ab.rig.read_programme(ROOT / "examples/rig/two_rates.toml")
    found = ab.rig.covariance(programme)
    table = found.to_dataframe()
    assert set(table["name"]) >= {"gyro_bias_x", "accel_bias_z"}
    assert (table["sigma"] <= table["prior_sigma"] * (1 + 1e-9)).all()
    assert all(p.png.startswith(b"\x89PNG") for p in found.plot())
    assert repr(found) == "<coarse: 21 parameters>"


def test_a_package_of_somebody_else_is_told_in_one_line(tmp_path: Path) -> None:
    assert foreign_packages() == {}
    (tmp_path / "thermo").mkdir()
    (tmp_path / "thermo/__init__.py").write_text("", encoding="utf-8")
    code = "from accelbench.start import main; raise SystemExit(main())"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {code}"],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "package thermo is a different package" in done.stderr
    assert "pipx install accelbench" in done.stderr
