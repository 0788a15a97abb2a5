"""The reference of the model file is enough to apply it: its own lines against the program."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.errors import InputError
from errormodel.model import ErrorModel
from thermo.compensation.compensate import compensate
from thermo.compensation.model_file import (
    FORMAT,
    ModelFile,
    dump_model,
    model_digest,
    reported_units,
    reporting_factors,
)
from thermo.library import term, thermal_library
from thermo.recording.files import RecordedRuns, make_runs

PAGE = Path(__file__).parents[3] / "docs/reference/model-file.md"
GRAVITY, OTHER_GRAVITY = 9.80665, 9.8156
PLAIN = ("k1", "k0", "k0_t1", "k0_t2", "k0_t3", "k0_t4", "k1_t1", "k1_t2", "k1_t3", "k1_t4",
         "k2", "k3", "delta_o", "delta_p", "k_ip", "k_io")  # fmt: skip
REMEMBERING = ("thermal_lag", "temperature_rate_bias", "temperature_rate_bias_slope",
               "temperature_rate_scale", "bias_hysteresis", "scale_hysteresis")  # fmt: skip
TWO_POLES = ("thermal_lag_two_poles", *REMEMBERING[1:])
MORE = ("warm_up", "indexer_harmonic", "indexer_harmonic_3", "indexer_harmonic_4",
        "output_nonlinearity", "output_nonlinearity_odd", "bias_hysteresis",
        "bias_hysteresis_start", "bias_hysteresis_plays", "scale_hysteresis",
        "scale_hysteresis_start", "scale_hysteresis_plays", "run_in", "bias_step", "bias_drift",
        "turn_on_offset_1", "remount_1")  # fmt: skip


def model_with(names: tuple[str, ...], *, has_input: bool = True) -> ModelFile:
    """Return a model file with made-up coefficients of an ordinary size."""
    rng = np.random.default_rng(3)
    errors = ErrorModel(tuple(term(n) for n in names))
    factors, units = reporting_factors(errors, 1.3), reported_units(errors, "mA")
    x4 = {f"{f}_t{k}": size / 50.0 ** (k - 1) for f, size in (("k0", 11e-6), ("k1", 80e-6))
          for k in range(1, 5)}  # fmt: skip
    held = {"k1": 1.0017, **x4}
    held |= {p.name: p.start for p in errors.parameters}
    values = {n: held.get(n, 2e-5 * rng.standard_normal()) for n in errors.names}
    one = {
        "serial": "Q1", "output_unit": "mA", "nominal_scale": 1.3, "gravity_m_s2": GRAVITY,
        "has_input": has_input, "t_ref_c": 25.0, "valid_c": (-30.0, 60.0),
        "valid_rate_c_per_min": (-1.2, 1.2), "terms": names, "names": errors.names,
        "coefficients": {n: {"value": values[n] * factors[n], "sigma": 0.0, "unit": units[n]}
                         for n in errors.names},
        "covariance": np.zeros((len(errors.names),) * 2).tolist(),
        "noise": {"white_ug": 4.0, "drift_ug": 0.0, "drift_tau_s": 3600.0},
        "residual_ug": 4.0, "heldout_residual_ug": None, "source_runs": {}, "n_samples": 100,
    }  # fmt: skip
    return ModelFile.model_validate(
        {"format": FORMAT, "model_id": model_digest([one]), "created_utc": "", "software": "",
         "accelerometers": [one]}
    )  # fmt: skip


def a_run() -> RecordedRuns:
    """Return 600 uneven readings over a ramp up, a hold and a ramp down, on another site."""
    rng = np.random.default_rng(4)
    time_s = np.cumsum(rng.uniform(8.0, 25.0, 600)) - 8.0
    end = time_s[-1]
    temp_c = np.interp(time_s, [0, 0.4 * end, 0.5 * end, end], [-35.0, 65.0, 65.0, -20.0])
    position = 45.0 * rng.integers(0, 8, 600)
    frame = pd.DataFrame(
        {
            "run": "R1", "serial": "Q1", "time_s": time_s,
            "temp_c": temp_c + 0.01 * rng.standard_normal(600), "position_deg": position,
            "output": 1.302 * np.sin(np.deg2rad(position)) + 1e-3 * rng.standard_normal(600),
        }
    )  # fmt: skip
    return make_runs(frame, output_unit="mA", gravity_m_s2=OTHER_GRAVITY, nominal_scale=1.3)


def lines_of_the_page() -> dict[str, object]:
    """Return what the page's Python block defines."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 1
    defined: dict[str, object] = {}
    exec(blocks[0], defined)
    return defined


@pytest.mark.parametrize(
    "names",
    [PLAIN, (*PLAIN, *REMEMBERING), (*PLAIN, *TWO_POLES), (*PLAIN, *MORE)],
    ids=["polynomials", "lag, rate and loops", "two poles", "all others"],
)
def test_the_lines_of_the_reference_give_the_numbers_of_the_program(names) -> None:
    runs, models = a_run(), model_with(names)
    entry = json.loads(dump_model(models))["accelerometers"][0]
    a_p = np.cos(np.deg2rad(runs.position_deg))
    found = lines_of_the_page()["apply"](  # type: ignore[operator]
        entry, np.asarray(runs.time_s), np.asarray(runs.temp_c), np.asarray(runs.output),
        OTHER_GRAVITY, a_p=a_p, head_deg=np.asarray(runs.position_deg),
    )  # fmt: skip
    expected = compensate(runs, models).accel_compensated_g
    assert np.max(np.abs(found - expected)) < 1e-9


def test_the_lines_of_the_reference_serve_a_model_without_input() -> None:
    runs = a_run()
    models = model_with(("k0", "k0_t1", "k0_t2", "thermal_lag"), has_input=False)
    entry = json.loads(dump_model(models))["accelerometers"][0]
    found = lines_of_the_page()["apply"](  # type: ignore[operator]
        entry, np.asarray(runs.time_s), np.asarray(runs.temp_c), np.asarray(runs.output),
        OTHER_GRAVITY,
    )  # fmt: skip
    assert np.max(np.abs(found - compensate(runs, models).accel_compensated_g)) < 1e-9


def test_every_predictive_term_of_the_library_is_tried() -> None:
    tried = {*PLAIN, *REMEMBERING, *TWO_POLES, *MORE}
    predictive = {n for n, make in thermal_library().terms.items() if make().predictive}
    page = PAGE.read_text(encoding="utf-8")
    not_covered = page.partition("These lines do not cover")[2].partition("```")[0]
    assert {n for n in predictive - tried if f"`{n}`" not in not_covered} == set()


def test_one_reading_at_a_time_is_the_whole_file_or_is_refused() -> None:
    runs, models = a_run(), model_with(PLAIN)
    whole = compensate(runs, models).accel_compensated_g
    for k in (0, 17, 599):
        assert compensate(runs.take(np.array([k])), models).accel_compensated_g[0] == whole[k]
    lagging = model_with((*PLAIN, "thermal_lag"))
    with pytest.raises(InputError, match=r"Q1 run R1: 1 reading\(s\); thermal_lag need the whole"):
        compensate(runs.take(np.array([17])), lagging)
    with pytest.raises(InputError, match=r"first reading is at time_s .*; thermal_lag need the ru"):
        compensate(runs.take(np.arange(300, 600)), lagging)
    begun = compensate(runs.take(np.arange(300)), lagging).accel_compensated_g
    # a piece from the start is the same but for the last readings, whose line lacks neighbours
    assert np.array_equal(begun[:290], compensate(runs, lagging).accel_compensated_g[:290])
