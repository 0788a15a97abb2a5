"""The folders of a spooled store."""

from pathlib import Path

import pytest


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state/accelbench/spool"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "night.sqlite"
