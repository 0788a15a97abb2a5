"""The stress left by assembly relaxes with travel and kicks less and less; it is made of terms."""

import numpy as np
import pytest

from drivers.station import InputConfig
from errormodel.record import Record
from tests.thermo.run_in.examples import cycling, state
from thermo.twin.accelerometer import emulated_accelerometer, newly_assembled
from thermo.twin.assembly_stress import BIAS, SCALE, AssemblyStress, assembly_stress
from thermo.twin.plant import Twin, TwinSettings

CALM = AssemblyStress(kick_share=0.0, hot_hours=1e12)


def test_the_stress_falls_to_1_over_e_in_its_cycles_whatever_their_shape() -> None:
    path = state(CALM, cycling(5))[0] / CALM.bias_ug
    # the record begins one reading, 220/24 °C, after the turning point
    assert path[0] == 1.0
    assert path[59] == pytest.approx(np.exp(-(59 / 24) / CALM.cycles), rel=1e-9)
    half = AssemblyStress(kick_share=0.0, hot_hours=1e12)
    small = Record(time_s=np.arange(441.0), signals={"x_slow_c": 10.0 * (np.arange(441) % 2)})
    assert state(half, small)[0][-1] / CALM.bias_ug == pytest.approx(
        np.exp(-4400 / (CALM.cycles * 220)), rel=1e-9
    )


def test_time_at_temperature_relaxes_too_and_more_so_when_hot() -> None:
    still = AssemblyStress(kick_share=0.0, hot_hours=100.0)
    time_s = np.linspace(0, 100 * 3600, 1000)
    hot, warm = (
        state(still, Record(time_s=time_s, signals={"x_slow_c": np.full(1000, x)}))[0][-1]
        for x in (45.0, 0.0)
    )
    assert hot / still.bias_ug == pytest.approx(np.exp(-1), rel=1e-9)  # 70 °C
    # Arrhenius by hand: 0.7 eV between 70 and 25 °C slows down by exp(0.7/k · 4.399e-4/K) = 35.7
    assert warm / still.bias_ug == pytest.approx(np.exp(-1 / 35.7), rel=1e-3)


def test_kicks_have_the_size_said_and_shrink_with_the_stress() -> None:
    record = cycling(12)
    smooth = state(CALM, record)[0] / CALM.bias_ug
    kicked = np.array(
        [
            state(AssemblyStress(hot_hours=1e12, seed=s), record)[0] / CALM.bias_ug - smooth
            for s in range(200)
        ]
    )
    by_cycle = np.diff(kicked[:, ::24], axis=1).std(axis=0)
    # four slips in a cycle, of 0.1/2 of the stress at the time each
    left = np.array([np.sqrt(np.mean(smooth[24 * k : 24 * k + 24] ** 2)) for k in range(11)])
    # 200 seeds know a standard deviation to 5 %; a slip at a reading's edge is one of four
    np.testing.assert_allclose(by_cycle / (0.1 * left), 1.0, atol=0.25)


def test_reading_by_reading_is_the_same_as_all_at_once() -> None:
    stress = assembly_stress("A")
    record = cycling(2)
    for term in stress.terms():
        whole, _ = term.columns(record, {}, None)
        memory = None
        for k in range(len(record)):
            one, memory = term.columns(record.take([k]), {}, memory)
            assert one[0, 0] == whole[k, 0]


def test_accelerometers_are_settled_unless_newly_assembled() -> None:
    plain = emulated_accelerometer("A")
    assert not {BIAS, SCALE} & set(plain.model.names)
    new = newly_assembled(plain, "A")
    assert {BIAS, SCALE} <= set(new.model.names)
    assert {n: new.values[n] for n in plain.values} == dict(plain.values)
    assert newly_assembled(plain, "A").values == new.values
    assert newly_assembled(plain, "B").values != new.values


def test_a_past_told_is_a_past_lived() -> None:
    """What a resumed emulated run-in does: the stress goes on where the readings say it was."""
    wired = InputConfig(serial="Q1", output_channel=101, thermistor_channel=111)
    quiet = TwinSettings(thermistor_noise_c=0.0, head_offset_arcsec=0.0, head_harmonic_arcsec=0.0)
    new = newly_assembled(emulated_accelerometer("Q1"), "Q1")
    silent = type(new)(model=new.model, values=new.values, white_ug=0.0, drift_ug=0.0)

    def twin() -> Twin:
        return Twin([wired], {"Q1": silent}, quiet)

    lived, told, fresh = twin(), twin(), twin()
    time_s = np.arange(0.0, 20_000.0, 20.0)
    lived.drive_chamber(0.0, 25.0, 70.0, 2 / 60)
    past = []
    for now_s in time_s:
        if now_s == 4000.0:
            lived.drive_chamber(now_s, 70.0, 25.0, 2 / 60)
        lived.channel_value(now_s, 101)
        past.append(lived.inside_temp_c(now_s, 0))
    told.relive("Q1", time_s, past)
    now = [t.channel_value(s, 101) for t, s in ((lived, 2e4), (told, 0.0), (fresh, 0.0))]
    scale = 1.3 * 1e-6  # V per µg
    assert abs(now[1] - now[0]) / scale < 1.0  # 0.01 °C of the end's temperature, 80 ppm/°C, 1 g
    assert abs(now[2] - now[0]) / scale > 20.0
