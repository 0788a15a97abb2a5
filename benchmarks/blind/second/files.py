"""A set as files of the public format, and its key in another folder."""

import json
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.second import library, outside
from benchmarks.blind.second.accelerometer import UNITS, Accelerometer
from benchmarks.blind.second.noise import FLICKER_TAUS_S, draw_readings, white_sigma
from benchmarks.blind.second.truth import Truth, make_truth

Floats = NDArray[np.float64]

GRAVITY = 9.8124
FIRST_DAY = datetime(2026, 3, 2, tzinfo=UTC)


def write_set(seed: int, folder: Path, keys: Path) -> dict[str, Any]:
    """Write `run.csv`, `run.toml` and perhaps `terms.toml`; `key.json` and `unseen.csv` apart.

    The unseen run is of the accelerometer that hides something; it has neither noise nor what
    belongs to a moment.
    """
    truth = make_truth(seed)
    rng = np.random.default_rng([20261202, seed])
    folder.mkdir(parents=True, exist_ok=True)
    keys.mkdir(parents=True, exist_ok=True)
    number = int(rng.choice([1, 2, 3], p=[0.7, 0.2, 0.1]))
    carrier = int(rng.integers(number))
    own = [truth.accelerometer if k == carrier else _companion(truth, rng) for k in range(number)]
    nominal = UNITS[truth.accelerometer.unit]
    if truth.accelerometer.unit == "count":
        nominal = 1e6 / truth.noise.count_ug
    columns = _columns(truth, rng)
    rows, unseen = [_header(columns)], [_header(columns)]
    for k, acc in enumerate(own):
        effects = _effects_ug(truth, k == carrier, unseen=False)
        rows += _rows(truth, acc, f"A{k + 1}", effects, nominal, columns, rng)
        if k == carrier:
            clean = _effects_ug(truth, True, unseen=True)
            unseen += _rows(truth, acc, f"A{k + 1}", clean, nominal, columns, None)
    (folder / "run.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (keys / "unseen.csv").write_text("\n".join(unseen) + "\n", encoding="utf-8")
    sidecar = _sidecar(truth, nominal)
    (folder / "run.toml").write_text(sidecar, encoding="utf-8")
    (keys / "unseen.toml").write_text(sidecar, encoding="utf-8")
    if truth.accelerometer.present == "terms":
        terms = json.dumps(list(truth.accelerometer.terms()))
        (folder / "terms.toml").write_text(f"terms = {terms}\n", encoding="utf-8")
    key = _key(truth, number, carrier, columns)
    (keys / "key.json").write_text(json.dumps(key), encoding="utf-8")
    return key


def _companion(truth: Truth, rng: np.random.Generator) -> Accelerometer:
    """Another of the type on the same head: other coefficients of the same terms."""
    acc = truth.accelerometer

    def others(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(v * float(rng.uniform(0.4, 1.6)) for v in values)

    static = {name: float(v * rng.uniform(-1.5, 1.5)) for name, v in acc.static.items()}
    scale = float(rng.normal(0, 3e-3))
    return replace(
        acc, bias=others(acc.bias), slopes=others(acc.slopes), static=static, scale=scale
    )


def _columns(truth: Truth, rng: np.random.Generator) -> tuple[str, ...]:
    """Names of the optional columns: recorded where the hidden effect needs them, or by chance."""
    needed = {outside.KINDS[h.name].column for h in truth.hidden if h.outside}
    chances = {"chamber_c": 0.4, "supply_v": 0.3, "flag": 0.4}
    return tuple(n for n, p in chances.items() if bool(rng.random() < p) or n in needed)


def _header(columns: tuple[str, ...]) -> str:
    return ",".join(["run", "serial", "time_s", "temp_c", "position_deg", "output", *columns])


def _effects_ug(truth: Truth, carries: bool, *, unseen: bool) -> Floats:
    total = np.zeros(len(truth.campaign.run))
    for h in truth.hidden:
        if (carries or h.name in library.SHARED) and not (unseen and h.name in library.EVENTS):
            total += h.column
    return total


def _rows(
    truth: Truth,
    acc: Accelerometer,
    serial: str,
    effects_ug: Floats,
    nominal: float,
    columns: tuple[str, ...],
    rng: np.random.Generator | None,
) -> list[str]:
    """Return the lines of one accelerometer: with noise, or of the unseen run without a `rng`."""
    c, noise = truth.campaign, truth.noise
    moving, written = c["moving"] > 0, truth.kept.copy()
    temp, added = c["temp_c"].copy(), np.zeros(len(c.run))
    if rng is None:
        written = c.unseen & ~moving
    else:
        if "flag" in columns:
            written |= moving & ~c.unseen
        white, slow = draw_readings(noise, c["elapsed_h"], c.run, rng)
        added = white + slow
        spoiled = rng.random(len(temp)) < noise.outlier_share
        far = rng.choice([-1.0, 1.0], len(temp)) * rng.uniform(20, 200, len(temp))
        added += spoiled * far * noise.white_ug
        temp += noise.thermistor_c * rng.standard_normal(len(temp))
    force = c.a_i + 1e-6 * (acc.input_ug(c) + effects_ug + added)
    output = nominal * (1 + acc.scale) * (1 + 1e-6 * acc.k1(c.x)) * force
    if rng is not None:
        step = 1e-6 * noise.count_ug * nominal
        output = np.round(output / step) * step
    lines = []
    for i in np.flatnonzero(written).tolist():
        cells = [f"r{c.run[i] + 1:02d}", serial, f"{c['t_s'][i]:.0f}", f"{temp[i]:.4f}"]
        cells += [f"{c['theta'][i]:.0f}", "" if moving[i] else f"{output[i]:.10g}"]
        extra = {
            "chamber_c": f"{c['chamber_c'][i]:.3f}",
            "supply_v": f"{c['supply_v'][i]:.4f}",
            "flag": "moving" if moving[i] else "",
        }
        lines.append(",".join(cells + [extra[name] for name in columns]))
    return lines


def _sidecar(truth: Truth, nominal: float) -> str:
    p = truth.campaign.protocol
    lines = [
        f'output_unit = "{truth.accelerometer.unit}"',
        f"gravity_m_s2 = {GRAVITY}",
        f"nominal_scale = {nominal!r}",
        "[run_start_utc]",
    ]
    for k, start in enumerate(p.starts_h):
        begun = FIRST_DAY + timedelta(seconds=round(3600 * start))
        lines.append(f"r{k + 1:02d} = {begun:%Y-%m-%dT%H:%M:%SZ}")
    return "\n".join(lines) + "\n"


def noise_rms_ug(truth: Truth) -> float:
    """Noise of a reading of one new run, rms: white, and the slow part that begins in it."""
    c, noise = truth.campaign, truth.noise
    white = white_sigma(noise, truth.accelerometer.slope_ug_per_c(c))[c.unseen]
    length_h = c["t_s"][c.unseen][-1] / 3600
    slow = len(FLICKER_TAUS_S) * noise.flicker_ug**2 + noise.walk_ug_per_rt_h**2 * length_h / 2
    return float(np.sqrt(np.mean(white**2) + slow))


def _key(truth: Truth, number: int, carrier: int, columns: tuple[str, ...]) -> dict[str, Any]:
    p, acc = truth.campaign.protocol, truth.accelerometer
    options = {"bare": ["--model", "bare"], "terms": ["--model", "terms.toml"], "default": []}
    effects = [_told(truth, h) for h in truth.hidden]
    return {
        "seed": truth.seed,
        "group": truth.group,
        "options": options[acc.present],
        "present": acc.present,
        "protocol": asdict(p) | {"mixed_rates": p.mixed_rates},
        "noise": asdict(truth.noise) | {"label": truth.noise.label},
        "columns": list(columns),
        "readings": int(truth.kept.sum()),
        "noise_rms_ug": noise_rms_ug(truth),
        "predictive": not any(h.name in library.EVENTS for h in truth.hidden),
        "accelerometers": [
            {
                "serial": f"A{k + 1}",
                "carrier": k == carrier,
                "hidden": [e for e in effects if k == carrier or e["name"] in library.SHARED],
            }
            for k in range(number)
        ],
    }


def _told(truth: Truth, h: Any) -> dict[str, Any]:
    kind = outside.KINDS.get(h.name)
    return {
        "name": h.name,
        "outside": h.outside,
        "factors": list(kind.factors) if kind else [],
        "names": list(kind.names) if kind else [],
        "size": h.size,
        "parameters": h.parameters,
        "rms_ug": float(np.sqrt(np.mean(h.column[truth.kept] ** 2))),
        "d": h.d,
        "d_beside": h.d_beside,
        "shares": h.shares,
    }
