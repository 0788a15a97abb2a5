"""Misbehaving instruments on real sockets and terminals: no wrong value is ever stored."""

import numpy as np
import pytest

from drivers.clock import SteppedClock
from drivers.digitisers.thermistor import ohm_from_temp_c
from drivers.station import FaultConfig, StationConfig
from tests.thermo.station.there_and_stay import there_and_stay
from thermo.launch.emulated import run_emulated
from thermo.planning.default_station import default_station
from thermo.planning.sequence import parse_sequence
from thermo.station.job import make_job
from thermo.store.store import open_store
from thermo.twin.plant import make_plant

SEQUENCE = there_and_stay(
    serials="AB",
    hold_min=1.0,
    to_c=33.0,
    rate_c_per_min=2.0,
    stay_min=1.0,
    period_s=15.0,
    angles_deg=(0.0, 90.0, 180.0, 270.0),
    more="""[limits]
chamber_c = [0.0, 45.0]
max_deviation_c = 4.0
max_deviation_min = 1.0
""",
)
# seconds of the emulation: the approach takes some 100 s, the ramp is from then 60 to 360
IN_RAMP_S = 220.0
REPLIES = (
    "silence",
    "late_reply",
    "exception",
    "broken_crc",
    "split_frame",
    "dropped_connection",
)
DEVICES = ("chamber", "digitiser", "head")


class Remembering:
    """A plant that remembers the noisy values it gave, so that each stored one can be traced."""

    def __init__(self, plant) -> None:
        self._plant = plant
        self.given: dict[int, set[float]] = {}
        self.air: list[float] = []

    def __getattr__(self, name):
        return getattr(self._plant, name)

    def channel_value(self, now_s, channel):
        value = self._plant.channel_value(now_s, channel)
        self.given.setdefault(channel, set()).add(value)
        return value

    def air_temp_c(self, now_s):
        value = self._plant.air_temp_c(now_s)
        self.air.append(value)
        return value


def quick(config: StationConfig, faults: list[FaultConfig]) -> StationConfig:
    """Give every instrument less patience, so that silence costs tenths of a second."""
    data = config.model_dump()
    for name in ("chamber", "digitiser", "head"):
        data[name]["timeout_s"] = 0.15
    data["emulation"] = {"faults": [f.model_dump() for f in faults]}
    return StationConfig.model_validate(data)


def run_with(tmp_path, faults: list[FaultConfig]):
    sequence = parse_sequence(SEQUENCE)
    config = quick(default_station(sequence), faults)
    plant = Remembering(make_plant(config))
    url = tmp_path / "store.sqlite"
    outcome = run_emulated(make_job(sequence, url, config), plant=plant, clock=SteppedClock())
    with open_store(url) as store:
        frame = store.readings(outcome.test_id)
        assert store.test(outcome.test_id).status == outcome.status
    assert outcome.safe.verified, outcome
    assert "\n" not in outcome.reason
    check_values(frame, config, plant)
    return outcome, frame


@pytest.mark.parametrize("device", DEVICES)
def test_every_spoilt_reply_is_survived(tmp_path, device):
    faults = [
        FaultConfig(device=device, kind=kind, at_s=IN_RAMP_S + 31.0 * k)
        for k, kind in enumerate(REPLIES)
    ]
    outcome, frame = run_with(tmp_path, faults)
    assert outcome.status == "finished", outcome.reason
    assert outcome.head_stopped
    # the one refusal that is not asked again costs a scan, and each other fault at most one more
    assert outcome.skipped <= len(REPLIES)
    assert frame.slot.nunique() + outcome.skipped == 28


@pytest.mark.parametrize("device", DEVICES)
def test_an_instrument_that_goes_on_refusing_ends_the_test(tmp_path, device):
    outcome, _ = run_with(
        tmp_path, [FaultConfig(device=device, kind="exception", at_s=IN_RAMP_S, count=60)]
    )
    assert outcome.status == "failed"
    assert f"{device}" in outcome.reason
    assert outcome.head_stopped is (device != "head")


@pytest.mark.parametrize(
    ("kind", "word"),
    [
        ("stuck_temperature", "stuck at"),
        ("sensor_break", "chamber"),
        ("over_temperature", "alarm"),
    ],
)
def test_a_chamber_that_fails_ends_the_test(tmp_path, kind, word):
    outcome, _ = run_with(tmp_path, [FaultConfig(device="chamber", kind=kind, at_s=IN_RAMP_S)])
    assert outcome.status == "failed"
    assert word in outcome.reason
    assert outcome.head_stopped


def check_values(frame, config, plant) -> None:
    """Every stored number is one the plant has given at that accelerometer's channel."""
    assert len(frame) > 10
    for entry in config.inputs:
        own = frame[frame.serial == entry.serial]
        volts = own.output.dropna().to_numpy() * entry.load_ohm / 1000
        ohms = ohm_from_temp_c(own.temp_c.dropna().to_numpy(), entry.thermistor)
        # the multimeter's format has nine digits
        assert _farthest(volts, plant.given[entry.output_channel]) < 1e-7
        assert _farthest(ohms, plant.given[entry.thermistor_channel]) < 0.01
        good = own[own.flag == ""]
        sin = np.sin(np.radians(good.position_deg.to_numpy()))
        # bias, misalignment and temperature terms of the emulated accelerometers are below 5 %
        np.testing.assert_allclose(good.output.to_numpy(), 1.3 * sin, atol=0.065)
    shown = frame.chamber_c.dropna().to_numpy()
    # the register shows float32 of what the sensor has
    assert _farthest(shown, set(plant.air)) < 1e-4


def _farthest(values, given) -> float:
    known = np.sort(np.fromiter(given, dtype=float))
    at = np.clip(np.searchsorted(known, values), 1, known.size - 1)
    gap = np.minimum(np.abs(values - known[at]), np.abs(values - known[at - 1]))
    return float(gap.max(initial=0.0))
