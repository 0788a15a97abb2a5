"""The documents are true: their commands run, their links lead somewhere, tables are whole."""

import importlib.util
import json
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import click
import numpy as np
import pytest

from accelbench.cli import accelbench, main
from errormodel.io.toml import read_toml
from thermo.fitting.fit import read_terms
from thermo.library import thermal_library
from thermo.planning.sequence import load_sequence
from thermo.recording.foreign.map import LogMap

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs/reference"
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *ROOT.glob("docs/**/*.md")])
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
COMMAND = re.compile(r"^ {4}accelbench (?!:)(.+)$", re.MULTILINE)


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def first_commands(path: Path) -> list[list[str]]:
    return [shlex.split(line) for line in COMMAND.findall(path.read_text(encoding="utf-8"))]


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference_tables", REFERENCE / "tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [str(REFERENCE), *sys.path])  # it imports its neighbours
        spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", DOCUMENTS, ids=name_of)
def test_every_relative_link_leads_to_a_file(path: Path) -> None:
    lost = [
        target
        for target in LINK.findall(path.read_text(encoding="utf-8"))
        if not re.match(r"[a-z]+:", target)
        and not (path.parent / target.partition("#")[0]).resolve().exists()
    ]
    assert lost == []


def test_every_document_can_be_reached_from_the_readme() -> None:
    seen: set[Path] = set()
    to_read = [ROOT / "README.md"]
    while to_read:
        path = to_read.pop()
        if path in seen or path.suffix != ".md":
            continue
        seen.add(path)
        targets = LINK.findall(path.read_text(encoding="utf-8"))
        inside = [t.partition("#")[0] for t in targets if not re.match(r"[a-z]+:", t)]
        to_read += [(path.parent / target).resolve() for target in inside]
    assert [name_of(p) for p in DOCUMENTS if p not in seen] == []


def test_pictures_are_small() -> None:
    pictures = list((ROOT / "docs/pictures").iterdir())
    assert pictures
    assert max(p.stat().st_size for p in pictures) < 200_000


@pytest.mark.parametrize("path", sorted(REFERENCE.glob("*.md")), ids=name_of)
def test_the_tables_of_the_reference_are_those_of_the_program(path: Path, tables) -> None:
    text = path.read_text(encoding="utf-8")
    assert text == tables.filled(text), "run: python docs/reference/tables.py"


def test_every_term_and_every_command_has_its_place_in_the_reference(tables) -> None:
    used = {
        name
        for path in REFERENCE.glob("*.md")
        for name in tables.BLOCK.findall(path.read_text(encoding="utf-8"))
    }
    assert used == set(tables.TABLES)
    terms = (REFERENCE / "terms.md").read_text(encoding="utf-8")
    assert [n for n in thermal_library().terms if f"| `{n}` |" not in terms] == []
    commands = (REFERENCE / "commands.md").read_text(encoding="utf-8")
    names = [name for name, _ in tables.leaves(accelbench)]
    assert [n for n in names if f"### {n}\n" not in commands] == []
    assert [n for n in names if f"| `{n}` | `" not in commands] == []  # its JSON keys


@pytest.mark.parametrize("path", DOCUMENTS, ids=name_of)
def test_every_command_line_printed_is_one_the_program_takes(path: Path, tables) -> None:
    known_commands = dict(tables.leaves(accelbench))
    for words in first_commands(path):
        if "…" in words or "[options]" in words:
            continue
        command = known_commands.get(words[0]) or known_commands.get(" ".join(words[:2]))
        assert command is not None, words
        known = {opt for p in command.params if isinstance(p, click.Option) for opt in p.opts}
        assert {w for w in words if w.startswith("--")} <= known | {"--json"}, words


def recorded_night(path: Path) -> None:
    """Write what the README shows the head of: one accelerometer, one ramp up and down."""
    rng = np.random.default_rng(0)
    lines = ["run,serial,time_s,temp_c,position_deg,output"]
    for k in range(400):
        temp_c = float(np.interp(k, [0, 200, 399], [-40.0, 70.0, -40.0]))
        angle = float(rng.choice([0.0, 45.0, 90.0, 180.0, 225.0, 270.0]))
        a_i, x = np.sin(np.deg2rad(angle)), temp_c - 25.0
        output = 1.3 * (1 + 8e-5 * x) * (a_i + 2e-4 + 1e-6 * x + 5e-6 * rng.standard_normal())
        lines.append(f"1,A17,{10 * k},{temp_c:.3f},{angle:g},{output:.9f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def code_after(text: str, title: str) -> str:
    """Return the indented block that follows a line."""
    block = text.partition(f"{title}\n\n")[2].partition("\n\n")[0]
    return "\n".join(line[4:] for line in block.splitlines()) + "\n"


def test_the_readme_s_own_recording_is_fitted_and_compensated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    Path("run.toml").write_text(code_after(readme, "`run.toml`"), encoding="utf-8")
    recorded_night(Path("run.csv"))
    header = code_after(readme, "`run.csv`").splitlines()[0]
    assert Path("run.csv").read_text(encoding="utf-8").splitlines()[0] == header
    commands = [c for c in first_commands(ROOT / "README.md") if c[0] in ("fit", "compensate")]
    assert [c[0] for c in commands] == ["fit", "compensate"]
    assert main([*commands[0], "--json"]) == 0
    (fitted,) = json.loads(capsys.readouterr().out)["accelerometers"]
    found = fitted["coefficients"]["k0"]
    assert abs(found["value"] - 200.0) < 5 * found["sigma"]
    assert Path("report/report.html").stat().st_size > 100_000  # its figures are in it
    assert main(commands[1]) == 0
    header = Path("compensated.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "accel_compensated_g" in header


def test_the_readme_s_dry_run_says_what_its_sequence_can_give(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (dry,) = [c for c in first_commands(ROOT / "README.md") if "--dry-run" in c]
    monkeypatch.chdir(ROOT)
    assert main(dry) == 0
    assert "Sigmas to expect" in capsys.readouterr().out


def test_the_tutorial_s_night_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same sequence with fewer readings: one run instead of two."""
    text = (ROOT / "docs/tutorial/first-night.toml").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    short = text.replace("repeats = 2\n", "repeats = 1\n")
    assert short != text
    Path("first-night.toml").write_text(short, encoding="utf-8")
    assert load_sequence("first-night.toml").temperature.repeats == 1
    commands = first_commands(ROOT / "docs/tutorial/first-night.md")
    (night,) = [c for c in commands if c[0] == "run" and "--dry-run" not in c]
    assert main(night) == 0
    assert "finished: all runs done" in capsys.readouterr().out
    for words in [c for c in commands if c[0] in ("fit", "compensate")][:2]:
        if "--report" in words:  # drawn in the test above; twice would cost seconds
            words = words[: words.index("--report")]
        assert main(words) == 0
    once, twice = [c for c in commands if c[0] == "compensate"]
    assert "compensated.csv" in once
    capsys.readouterr()
    assert main(twice) == 2
    assert "already compensated" in capsys.readouterr().err


def test_the_terms_and_mappings_shown_are_taken(tmp_path: Path) -> None:
    howto = (ROOT / "docs/how-to/choose-terms.md").read_text(encoding="utf-8")
    path = tmp_path / "TERMS.toml"
    path.write_text(code_after(howto, "A TERMS.toml names the [terms](../reference/terms.md):"))
    assert "bias_hysteresis" in (read_terms(path).terms or ())
    mapping = (ROOT / "docs/how-to/map-a-foreign-log.md").read_text(encoding="utf-8")
    block = mapping.partition("## The least\n\n")[2].partition("\n## ")[0]
    path.write_text("\n".join(line[4:] for line in block.splitlines()), encoding="utf-8")
    assert read_toml(path, LogMap).accelerometers[0].serial == "A17"
