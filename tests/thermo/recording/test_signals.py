"""Signals: made of columns where they are there, read and checked by their one entry."""

import numpy as np
import pytest

from errormodel.errors import InputError
from tests.thermo.examples import NOMINAL, simulate_run
from thermo.recording.channel import channel_of
from thermo.recording.files import RecordedRuns, join_runs, make_runs
from thermo.recording.signals import Signal, signals, using_signals

GRADIENT = Signal(
    name="gradient_c",
    unit="°C",
    sentence="Temperature less that of the chamber.",
    make=lambda at: at.temp_c - at.columns["chamber_c"],
    columns=("chamber_c",),
)
PRESSURE = Signal(
    name="pressure_kpa", unit="kPa", sentence="Of the air.", recorded=True, within=(1.0, 200.0)
)


def recorded(run: str = "1", **columns: object) -> RecordedRuns:
    frame = simulate_run(np.random.default_rng(3), n=50, run=run).assign(**columns)
    return make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL)


def test_a_signal_is_made_of_a_column_where_the_column_is_there() -> None:
    with using_signals((*signals(), GRADIENT)):
        made = channel_of(recorded(chamber_c=20.0), "A").record
        np.testing.assert_allclose(made["gradient_c"], made["x_c"] + 5.0)
        assert "gradient_c" not in channel_of(recorded(), "A").record.signals
    assert "gradient_c" not in channel_of(recorded(chamber_c=20.0), "A").record.signals


def test_a_recorded_signal_stays_with_its_rows_and_is_checked() -> None:
    values = np.linspace(90.0, 110.0, 50)
    with using_signals((*signals(), PRESSURE)):
        one, other = recorded(pressure_kpa=values), recorded("2")
        joined = join_runs([one, other])
        assert joined.columns_in_use()[-1] == "pressure_kpa"
        np.testing.assert_array_equal(joined.select(runs=["1"]).more["pressure_kpa"], values)
        assert np.isnan(joined.select(runs=["2"]).more["pressure_kpa"]).all()
        assert "pressure_kpa" in channel_of(one, "A").record.signals
        # of two runs only one has it: no model can use it
        assert "pressure_kpa" not in channel_of(joined, "A").record.signals
        with pytest.raises(InputError, match="pressure_kpa 300, expected 1 to 200 kPa"):
            recorded(pressure_kpa=300.0)
        with pytest.raises(InputError, match="pressure_kpa is infinite"):
            recorded(pressure_kpa=np.inf)
        assert one.digest("1") == recorded().digest("1")
    assert recorded(pressure_kpa=values).more == {}
