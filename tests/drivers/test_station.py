"""The station file refuses what no instrument can be."""

import pytest
from pydantic import ValidationError

from drivers.devices import CHAMBER_C
from drivers.station import StationConfig
from tests.drivers.test_opening import station_config


def revalidated(**wiring):
    data = station_config().model_dump() | {"inputs": [wiring]}
    return StationConfig.model_validate(data)


@pytest.mark.parametrize("limits_c", [(-55.0, 1e6), (-1e6, 85.0), (-273.0, 85.0), (-55.0, 400.1)])
def test_limits_beyond_any_chamber_are_refused(limits_c):
    with pytest.raises(ValidationError, match="limits_c must lie within -200 to 400 °C"):
        station_config(chamber={"limits_c": limits_c})
    widest = (CHAMBER_C.lo, CHAMBER_C.hi)
    assert station_config(chamber={"limits_c": widest}).chamber.limits_c == widest


@pytest.mark.parametrize("section", ["chamber", "digitiser", "head"])
@pytest.mark.parametrize("timeout_s", [0.0, -1.0, 60.1, 1e9, float("inf"), float("nan")])
def test_a_time_limit_that_watches_nothing_is_refused(section, timeout_s):
    with pytest.raises(ValidationError, match="timeout_s"):
        station_config(**{section: {"timeout_s": timeout_s}})
    assert station_config(**{section: {"timeout_s": 60.0}})


@pytest.mark.parametrize("rates", [(0.05, 1e6), (0.05, 100.1)])
def test_rates_beyond_any_chamber_are_refused(rates):
    with pytest.raises(ValidationError, match="rate_limits_c_per_min"):
        station_config(chamber={"rate_limits_c_per_min": rates})


@pytest.mark.parametrize("channel", [100, 121, 122, 199, 200, 221, 300, 321, 399, 401, 1])
@pytest.mark.parametrize("key", ["output_channel", "thermistor_channel"])
def test_channels_that_measure_neither_voltage_nor_resistance_are_refused(key, channel):
    wired = {"serial": "QA-1", "output_channel": 101, "thermistor_channel": 111} | {key: channel}
    with pytest.raises(ValidationError, match="expected 101 to 120, 201 to 220 or 301 to 320"):
        revalidated(**wired)


@pytest.mark.parametrize(("output", "thermistor"), [(101, 120), (201, 220), (301, 320), (120, 301)])
def test_channels_of_all_slots_are_taken(output, thermistor):
    config = revalidated(serial="QA-1", output_channel=output, thermistor_channel=thermistor)
    assert config.inputs[0].output_channel == output
