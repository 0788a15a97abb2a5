"""The house keeps its shape: small folders, short files."""

from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "accelbench",
    "benchmarks",
    "docs",
    "drivers",
    "errormodel",
    "sinscal",
    "tests",
    "thermo",
)
# what a reader takes in at one look, and in one sitting
MOST_FILES = 16
MOST_LINES = 350

MODULES = sorted(path for name in PACKAGES for path in (ROOT / name).rglob("*.py"))


def test_no_folder_holds_more_than_sixteen_modules() -> None:
    count = Counter(path.parent for path in MODULES if path.name != "__init__.py")
    assert {str(f.relative_to(ROOT)): n for f, n in count.items() if n > MOST_FILES} == {}


def test_no_module_is_longer_than_a_sitting() -> None:
    lines = {path: path.read_text(encoding="utf-8").count("\n") for path in MODULES}
    assert {str(p.relative_to(ROOT)): n for p, n in lines.items() if n > MOST_LINES} == {}
