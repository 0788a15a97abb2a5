"""Readings in coarse counts: sigmas stay true when the sidecar states the step."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from errormodel.errors import InputError
from sinscal.calibration.noise import accel_density, gyro_density
from sinscal.frames.earth import ARCSEC, DEG_PER_H
from sinscal.judgement.judge import Judged
from sinscal.judgement.options import Options
from sinscal.judgement.procedure import calibrate_and_judge
from sinscal.recording.files import read_rig_run, write_rig_run
from sinscal.recording.run import Quantum, RigRun
from sinscal.twin.simulate import SensorNoise
from tests.sinscal.twin import EXACT_AXIS, Twin, make_twin

# 1e-3 m/s are over an interval of 1 s four times the noise of the accelerometers
COUNTED = SensorNoise(
    gyro=0.1 * DEG_PER_H, accel=1e-4, angle=15 * ARCSEC, gyro_quantum=5 * ARCSEC, accel_quantum=1e-3
)
COARSE = Options(hold_out="none")
PRECISE = Options(mode="precise", wobble=EXACT_AXIS, hold_out="none")


def assert_true(twin: Twin, judged: Judged) -> None:
    assert judged.passed, judged.warnings
    assert judged.warnings == ()
    assert judged.consistency.nis.passed
    assert twin.chi2(judged) < chi2.isf(0.001, len(judged.found.names))


@pytest.mark.parametrize("options", [COARSE, PRECISE], ids=["coarse", "precise"])
def test_counts_of_increments_that_are_stated_leave_white_innovations(options: Options) -> None:
    twin = make_twin(1, noise=COUNTED, angle=options.mode == "precise")
    assert twin.run.facts.quantum == Quantum(gyro_rad=5 * ARCSEC, accel_m_s=1e-3)
    assert_true(twin, calibrate_and_judge(twin.run, options))


def test_counts_that_are_not_stated_do_not_pass() -> None:
    twin = make_twin(1, noise=COUNTED)
    silent = replace(twin.run, facts=replace(twin.run.facts, quantum=Quantum()))
    assert not calibrate_and_judge(silent, COARSE).passed


def rounded(run: RigRun, quantum: Quantum) -> RigRun:
    """Return a run with every reading rounded by itself, and its step stated."""
    gyro, accel = quantum.gyro_rad_s, quantum.accel_m_s2
    return replace(
        run,
        gyro=gyro * np.round(run.gyro / gyro),
        accel=accel * np.round(run.accel / accel),
        facts=replace(run.facts, quantum=quantum),
    )


def test_readings_rounded_to_twice_their_noise_have_true_sigmas() -> None:
    """A step of twice the noise adds a third to its variance; not told, NIS would be 1.3."""
    noise = SensorNoise(gyro=0.1 * DEG_PER_H, accel=1e-3)
    twin = make_twin(2, noise=noise)
    spread = 1.9 * np.sqrt(50.0)
    step = Quantum(gyro_rad_s=spread * noise.gyro, accel_m_s2=spread * noise.accel)
    assert_true(twin, calibrate_and_judge(rounded(twin.run, step), COARSE))


def test_steps_that_noise_does_not_spread_over_are_told() -> None:
    twin = make_twin(2)
    noise = twin.run.facts.gyro_noise
    assert noise is not None
    step = Quantum(gyro_rad_s=4.0 * np.sqrt(50.0) * noise, accel_m_s2=1e-6)
    judged = calibrate_and_judge(rounded(twin.run, step), COARSE)
    (told,) = [w for w in judged.warnings if w.startswith("coarse_steps")]
    assert "readings of the gyros are rounded" in told


def test_the_noise_behind_counts_is_measured_without_their_share() -> None:
    """A tenth: the sigma of a density in 600 s, and what is not normal of a counter's error."""
    noise = replace(COUNTED, accel=1e-3, accel_quantum=5e-4, gyro_quantum=0.05 * ARCSEC)
    run = make_twin(3, noise=noise).run
    assert accel_density(run).value == pytest.approx(noise.accel, rel=0.1)
    assert gyro_density(run).value == pytest.approx(noise.gyro, rel=0.1)


def test_the_step_is_written_to_the_sidecar_and_read_again(tmp_path: Path) -> None:
    run = make_twin(1, noise=COUNTED, cycle_s=30.0).run
    path = tmp_path / "run.csv"
    write_rig_run(run, path, increments=True)
    assert read_rig_run(path).facts.quantum == run.facts.quantum
    side = path.with_suffix(".toml")
    side.write_text(side.read_text() + "[quantum]\n", encoding="utf-8")
    with pytest.raises(InputError, match="quantum"):
        read_rig_run(path)


def test_a_sensor_has_one_kind_of_step(tmp_path: Path) -> None:
    run = make_twin(1, cycle_s=30.0).run
    path = tmp_path / "run.csv"
    write_rig_run(run, path)
    side = path.with_suffix(".toml")
    both = "quantum = { accel_m_s = 1e-5, accel_m_s2 = 1e-3 }\n"
    side.write_text(side.read_text() + both, encoding="utf-8")
    with pytest.raises(InputError, match="accel_m_s and accel_m_s2: expected one of them"):
        read_rig_run(path)
