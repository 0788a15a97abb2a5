"""Run accelbench on a set-up and hold what it says against the truth."""

import contextlib
import io
import json
import re
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from accelbench.cli import main
from tests.strangers.chamber.physics import Array, Run, columns, forces
from tests.strangers.chamber.setups import AXES, HEADS, SetUp

SERIAL, CRASH = "A1", 99
POINTERS = (
    r"still follows|of the residual change|times the noise|too many readings"
    r"|is longer than a run|thermal-history|runs? differ by|lies apart"
    r"|reduces slopes|coarser than its noise|is not noise"
    r"|left out as clipped|left out as flat|not determined there"
)
# What a test cannot show is said of sound runs too: it points at a kind only where it names it.
_DRIFTS = {"sound, drift", "walk", "flicker", "linear", "daily", "step"}
_RUNS = {"runs K0", "runs K1", "runs thermistor", "odd run"}
_WITH_DIRECTION = {"gradient", "gradient of scale", "lag", "loop of bias", "loop of scale"}
ELSEWHERE = "another site"
STANDING: dict[str, set[str]] = {
    "one direction only": _DRIFTS | _WITH_DIRECTION,
    "one run:": _RUNS | _DRIFTS,
    "highest order that is tried": {"knee of bias", "knee of scale"},
    "hardly shows.*gains that differ": {"asymmetry"},
    "hardly shows.*settling": {"unsettled"},
    "hardly shows.*loop of the scale": {"loop of scale"},
    "hardly shows.*change of k2": {"K2 over temperature"},
    "hardly shows.*loop of the bias": {"loop of bias"},
    "K0 and its slopes.*include the input": {
        "K2 over temperature",
        "misalignment over temperature",
        "knee of scale",
    },
    "hardly shows.*change of misalignment": {"misalignment over temperature"},
    "K1 was taken as nominal": {ELSEWHERE},
}


@dataclass
class Verdict:
    """What a set-up gave: exit codes, the largest |z| and where, and the text."""

    fit_code: int
    apply_code: int = 0
    z: dict[str, float] = field(default_factory=dict[str, float])
    text: str = ""
    kinds: frozenset[str] = frozenset()

    @property
    def worst(self) -> tuple[str, float]:
        """The figure that is furthest from the truth, in its own sigmas."""
        name = max(self.z, key=lambda n: abs(self.z[n]), default="")
        return name, self.z.get(name, 0.0)

    @property
    def pointers(self) -> list[str]:
        """Lines of text that say more than sound runs get to read."""
        named = [words for words, kinds in STANDING.items() if kinds & self.kinds]
        pattern = "|".join([POINTERS, *named])
        return [w.strip() for w in self.text.splitlines() if re.search(pattern, w)]

    @property
    def silent(self) -> bool:
        """Whether a figure is wrong beyond chance, and neither exit code nor text tells."""
        if CRASH in (self.fit_code, self.apply_code):
            return True
        told = self.fit_code or self.apply_code or self.pointers
        return abs(self.worst[1]) > 5.0 and not told


def call(*words: str | Path) -> tuple[int, str]:
    """Run the command; return its exit code, CRASH for a traceback, and all it printed."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
        try:
            code = main([str(w) for w in words])
        except SystemExit as leave:
            code = leave.code
        except Exception:
            told.write(traceback.format_exc())
            code = CRASH
    return int(code or 0), told.getvalue()


def write(runs: list[Run], path: Path, how: SetUp, gravity: float) -> None:
    """Write runs as the recorded run that the documents describe."""
    header = "run,serial,time_s,temp_c,output"
    where = {"none": "", "forces": ",a_i_g,a_p_g,a_o_g"}.get(how.head, ",position_deg")
    lines = [header + where]
    for k, run in enumerate(runs, start=1):
        for n, at in enumerate(run.time_s):
            cells = f"r{k},{SERIAL},{at:.3f},{run.temp_c[n]:.5f},{run.output[n]:.12g}"
            if where == ",position_deg":
                cells += f",{run.position_deg[n]:.0f}"
            elif where:
                cells += "".join(f",{a:.9f}" for a in run.force_g[n])
            lines.append(cells)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    told = f'output_unit = "{how.unit}"\ngravity_m_s2 = {gravity}\nnominal_scale = {how.nominal}\n'
    if how.faults["state_temp"]:
        told += "temp_sigma_c = 0.3\n"
    path.with_suffix(".toml").write_text(told, encoding="utf-8")


def judge(how: SetUp, folder: Path) -> Verdict:
    """Fit a set-up's runs, compensate one more, and compare both with the truth."""
    folder.mkdir(parents=True, exist_ok=True)
    runs, model, terms = folder / "runs.csv", folder / "model.json", folder / "terms.toml"
    write(how.record(), runs, how, how.gravity)
    head = 4.1 if how.faults["state_head"] else 0.0
    terms.write_text(f"t_ref_c = {how.t_ref_c}\nhead_arcsec = {head}\n", encoding="utf-8")
    code, text = call("fit", runs, "--model", terms, "--out", model, "--force")
    kinds = frozenset([*how.kinds, *([ELSEWHERE] if how.there != how.gravity else [])])
    found = Verdict(code, text=text, kinds=kinds)
    if model.exists() and code in (0, 1):
        following, out = folder / "next.csv", folder / "compensated.csv"
        write([how.following()], following, how, how.there)
        code, text = call("compensate", following, "--model", model, "--out", out, "--force")
        found.apply_code, found.text = code, f"{found.text}\n--- compensate\n{text}"
        found.z = compare(how, folder)
    (folder / "text.txt").write_text(found.text, encoding="utf-8")
    return found


def compare(how: SetUp, folder: Path) -> dict[str, float]:
    """Return how far coefficients and compensated readings are from the truth, in sigmas."""
    told = json.loads((folder / "model.json").read_text(encoding="utf-8"))["accelerometers"][0]
    truth = _seen(how, told)
    # a knee is no polynomial: what its coefficients should be nobody can say
    loose = ("k0",) * bool(how.faults["kink_ug"]) + ("k1",) * bool(how.faults["k1_kink_ppm"])
    z = {
        name: (got["value"] - truth.get(name, 0.0)) / got["sigma"]
        for name, got in told["coefficients"].items()
        if got["sigma"] and name[:2] not in loose
    }
    if (folder / "compensated.csv").exists():
        z |= _compensated(how, folder, told["has_input"])
    return {name: float(value) for name, value in z.items()}


def _seen(how: SetUp, told: dict[str, Any]) -> dict[str, float]:
    """Return the truth with what the model lacks put where the text says that it stands."""
    constant = "k1" not in told["coefficients"] and how.head in ("up", "none")
    truth = how.truth(constant)
    truth["k0"] += how.faults["asymmetry_ug"] * constant
    if constant:
        truth["k0"] -= 1e6 * told["has_input"]
        return truth
    middle = sum(told["valid_c"]) / 2.0 - 25.0
    truth["k2"] += middle * how.faults["k2_slope"]
    truth["delta_o"] += middle * how.faults["delta_slope"]
    column = columns(AXES if how.head == "forces" else forces(np.array(HEADS[how.head])))
    fitted = [name for name in column if name in told["coefficients"]]
    lacking = [truth[n] * c for n, c in column.items() if n in truth and n not in fitted]
    if fitted and lacking:
        basis = np.column_stack([column[n] for n in fitted])
        moved: Array = np.linalg.lstsq(basis, np.sum(lacking, axis=0), rcond=None)[0]
        for name, more in zip(fitted, moved, strict=True):
            truth[name] += more if name != "k1" else 1e-6 * more * truth["k1"]
    return truth


def _compensated(how: SetUp, folder: Path, has_input: bool) -> dict[str, float]:
    """Return the median error of a fresh run by position and 10 °C, in stated sigmas."""
    run = how.following()
    header, *rows = (folder / "compensated.csv").read_text(encoding="utf-8").splitlines()
    cells = [dict(zip(header.split(","), row.split(","), strict=True)) for row in rows]
    good = np.array([not c["flag"] for c in cells])
    value = np.array([float(c["accel_compensated_g"] or "nan") for c in cells])
    sigma = np.array([float(c["accel_sigma_g"] or "nan") for c in cells])
    error = value - run.force_g[:, 0]
    z = (error - (0.0 if has_input else np.median(error[good]))) / sigma
    groups = np.unique(run.force_g[:, 0].round(6), return_inverse=True)[1]
    bins = (run.temp_c // 10.0).astype(int) * 100 + groups
    found: dict[str, float] = {}
    for which in np.unique(bins[good]):
        here = good & (bins == which)
        if here.sum() >= 8:
            found[f"compensated bin {which}"] = float(np.median(z[here]))
    return found
