"""A residual that follows the position: told with the positions, and silent where there is none."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from accelbench.commands.fit.doubts import doubt_sentences
from tests.thermo.fitting.strange_runs import NOMINAL, Setup, campaign
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.files import RecordedRuns, make_runs
from thermo.recording.readings_check import flag_readings
from thermo.uncertainty.by_position import ByPosition

SMALL = Setup(runs=2, corners_c=(20.0, 45.0, 20.0), rates=(1.0,), drift_ug=0.0)


def changed(setup: Setup, seed: int, kind: str) -> RecordedRuns:
    """Return a campaign with a fault of the readout or of the positions."""
    runs = campaign(setup, seed)
    output, position = np.array(runs.output), np.array(runs.position_deg)
    a_i, a_p = np.sin(np.deg2rad(position)), np.cos(np.deg2rad(position))
    if kind == "asymmetry":
        output += NOMINAL * 30e-6 * np.abs(a_i)
    elif kind == "position":
        position = np.where(position == 45.0, 44.0, position)
    elif kind == "tilt":  # with the temperature, as |a_p|: no term of the model
        output += NOMINAL * 2e-6 * (runs.temp_c - 32.5) * np.abs(a_p)
    elif kind == "clipped":
        output = np.clip(output, -1.2, 1.2)
    return make_runs(
        pd.DataFrame(
            {
                "serial": "Q1",
                "run": [runs.run.at(k) for k in range(len(runs))],
                "time_s": runs.time_s,
                "temp_c": runs.temp_c,
                "position_deg": position,
                "output": output,
            }
        ),
        output_unit="mA",
        gravity_m_s2=9.80665,
        nominal_scale=NOMINAL,
    )


def followed(runs: RecordedRuns, terms: TermsFile | None = None) -> tuple[ByPosition | None, str]:
    (one,) = fit_runs(runs, terms=terms)
    return one.doubts.by_position, "\n".join(doubt_sentences(one))


@pytest.mark.parametrize("kind", ["asymmetry", "position", "clipped"])
def test_misfit_by_position_is_told_and_called_no_noise(kind: str) -> None:
    found, said = followed(changed(SMALL, 3, kind))
    assert found is not None
    assert found.sigmas > 5.0
    assert "this is not noise" in said
    if kind != "clipped":  # the cut grows with K1 over temperature
        assert not found.over_temperature
        assert "the residual follows the position" in said
    if kind == "position":
        assert "44°" in found.alone


def test_misfit_of_positions_over_temperature_is_told() -> None:
    found, said = followed(changed(SMALL, 4, "tilt"))
    assert found is not None
    assert found.over_temperature
    assert "as k2 does" in said


def test_sound_readings_follow_no_position() -> None:
    for seed in (5, 6, 7):
        found, _ = followed(campaign(SMALL, seed))
        assert found is None


def test_a_stated_head_may_err_at_each_position_by_as_much() -> None:
    runs = campaign(SMALL, 8)
    position = np.array(runs.position_deg)
    off = np.where(position == 45.0, 4.0, 0.0) * np.pi / 648000.0  # 4″ at one position
    output = np.array(runs.output) + NOMINAL * off * np.cos(np.deg2rad(position))
    bent = replace(runs, output=output)
    assert followed(bent)[0] is not None
    assert followed(bent, TermsFile(head_arcsec=4.0))[0] is None


def test_a_position_whose_every_reading_is_cut_off_is_found_in_few_visits() -> None:
    short = replace(SMALL, runs=1, dwell_s=20.0, step_s=20.0)
    flagged = flag_readings(changed(short, 9, "clipped"))
    cut = np.abs(np.sin(np.deg2rad(flagged.position_deg))) > 0.99
    assert cut.sum() < 50
    names = [flagged.flag.at(k) for k in range(len(flagged))]
    assert all((name == "clipped") == bool(is_cut) for name, is_cut in zip(names, cut, strict=True))
