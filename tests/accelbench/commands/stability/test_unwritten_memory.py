"""What a command tells does not depend on what memory held before.

glibc fills what it gives and takes back with a byte of our choice (MALLOC_PERTURB_, mallopt(3)):
a figure that is read from memory nobody wrote differs from one choice to the next.
"""

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.accelbench.program import ROOT
from tests.thermo.stability.examples import one_run

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="MALLOC_PERTURB_ is glibc's"),
]
SIDECAR = 'output_unit = "mA"\ngravity_m_s2 = 9.80665\nnominal_scale = 1.3\n'


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five runs at one temperature, and three over ranges that share one temperature only."""
    rng = np.random.default_rng(51)
    spans = [(25.0, 25.2)] * 5
    frames = [
        one_run(rng, "A", f"r{k}", {"k0": 12.0 * rng.standard_normal()}, n=60, span_c=span)
        for k, span in enumerate(spans)
    ]
    frames += [
        one_run(rng, "B", f"r{k}", {"k0": 12.0 * rng.standard_normal()}, n=120, span_c=span)
        for k, span in enumerate(((25.0, -10.0, 30.0), (25.0, 60.0, 30.0), (25.0, 0.0, 40.0)))
    ]
    folder = tmp_path_factory.mktemp("still")
    pd.concat(frames).to_csv(folder / "runs.csv", index=False)
    (folder / "runs.toml").write_text(SIDECAR)
    return folder


@pytest.mark.parametrize("command", ["stability", "fit", "runin"])
def test_the_same_is_told_whatever_memory_held(still: Path, command: str) -> None:
    told: set[str] = set()
    for byte in ("0", "85", "170", "255"):
        done = subprocess.run(
            [sys.executable, "-c", "import sys; from accelbench.cli import main; sys.exit(main())",
             command, "runs.csv", "--json"],
            cwd=still,
            env=os.environ
            | {"PYTHONPATH": str(ROOT), "PYTHONMALLOC": "malloc", "MALLOC_PERTURB_": byte},
            capture_output=True,
            text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode in (0, 1), done.stderr
        told.add(done.stdout)
    assert len(told) == 1
