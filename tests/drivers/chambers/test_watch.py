"""What a chamber tells of others who command it: occupation, foreign changes, a loop left off."""

import pytest

from drivers.chambers.open import open_chamber
from drivers.clock import SteppedClock
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import FaultPlan
from drivers.emulators.station import EmulatedStation
from drivers.errors import DeviceError
from drivers.station import ChamberConfig
from tests.drivers.chambers.foreign_controllers import ForeignF4, ForeignF4T
from tests.drivers.conftest import BenchPlant
from tests.drivers.ideal_plant import IdealPlant
from tests.drivers.test_opening import station_config

MODELS = ("watlow_f4t", "watlow_f4", "eurotherm_3504")


class Bench:
    """An emulated chamber, recognised, and its panel."""

    def __init__(self, model):
        self.model = model
        self.clock = SteppedClock(1000.0)
        self.plant = IdealPlant(air_c=23.4)
        self.faults = FaultPlan([], "chamber", self.clock)
        self.emulator = ChamberEmulator(model, self.plant, self.clock, self.faults)
        self.emulator.start()
        self.panel = self.emulator.controller
        config = ChamberConfig(model=model, url=self.emulator.url, timeout_s=5.0)
        self.chamber = open_chamber(config)
        self.chamber.identify()

    def wait(self, seconds):
        self.clock.sleep_until_s(self.clock.now_s() + seconds)

    def set_register(self, address, word):
        self.panel.write(address, [word])

    def close(self):
        self.chamber.close()
        self.emulator.close()


@pytest.fixture(params=MODELS)
def bench(request):
    bench = Bench(request.param)
    yield bench
    bench.close()


@pytest.fixture
def make_bench():
    """Return a function that makes the bench of one model."""
    made = []

    def make(model):
        made.append(Bench(model))
        return made[-1]

    yield make
    for bench in made:
        bench.close()


@pytest.fixture
def drive():
    """Return a function that opens and recognises a foreign controller."""
    opened = []

    def make(bank):
        model = "watlow_f4" if isinstance(bank, ForeignF4) else "watlow_f4t"
        chamber = open_chamber(ChamberConfig(model=model, url=bank.url, timeout_s=5.0))
        opened.extend((chamber, bank))
        chamber.identify()
        return chamber

    yield make
    for one in opened:
        one.close()


# ---- occupation


def test_a_chamber_at_rest_is_free_and_so_is_one_that_this_driver_commands(bench):
    chamber = bench.chamber
    assert chamber.read_occupation() == ()
    chamber.hold_temp_c(40.0)
    assert chamber.read_occupation() == ()
    chamber.ramp_to_c(30.0, 1.0)
    assert chamber.read_occupation() == ()
    bench.wait(3600.0)
    assert chamber.read_occupation() == ()


def test_somebodys_profile_occupies_it(bench):
    bench.panel.operate("foreign_profile", 70.0)
    bench.wait(3600.0)
    told = {
        "watlow_f4t": "profile runs, set point 70 °C",
        "watlow_f4": "profile 40 runs, set point 70 °C",
        "eurotherm_3504": "program runs, set point 70 °C",
    }
    assert bench.chamber.read_occupation() == (told[bench.model],)


@pytest.mark.parametrize(
    ("model", "address", "word", "told"),
    [
        ("watlow_f4t", 2730, 62, "loop is off"),
        ("watlow_f4t", 2730, 54, "loop is in manual"),
        ("watlow_f4t", 16568, 146, "profile is paused, set point 23.4 °C"),
        ("watlow_f4t", 16568, 1783, "profile waits for its start, set point 23.4 °C"),
        ("eurotherm_3504", 273, 1, "loop is in manual"),
        ("eurotherm_3504", 276, 1, "set point is remote, set point 23.4 °C"),
        ("eurotherm_3504", 5195, 4, "program is held, set point 23.4 °C"),
        ("eurotherm_3504", 5195, 16, "program has ended and still governs, set point 23.4 °C"),
    ],
)
def test_each_other_master_occupies_it(make_bench, model, address, word, told):
    bench = make_bench(model)
    bench.set_register(address, word)
    assert bench.chamber.read_occupation() == (told,)


def test_a_foreign_f4t_and_f4_tell_their_profiles(drive):
    f4t = ForeignF4T(profile=149)
    assert drive(f4t).read_occupation() == ("profile runs, set point 70 °C",)
    f4 = ForeignF4()
    f4.state = 3
    assert drive(f4).read_occupation() == ("profile 3 is paused, set point 70 °C",)
    assert f4.writes == f4t.writes == []


# ---- foreign changes


def test_nothing_is_foreign_before_the_first_command(bench):
    bench.panel.operate("setpoint_changed", 80.0)
    assert bench.chamber.read_foreign_changes() == ()


@pytest.mark.parametrize("temp_c", [60.0, 60.04, -12.34, 0.0, 85.0, -55.0])
def test_what_was_commanded_is_never_foreign_whatever_its_rounding(bench, temp_c):
    bench.chamber.hold_temp_c(temp_c)
    for _ in range(3):
        assert bench.chamber.read_foreign_changes() == ()
        bench.wait(60.0)
    assert bench.chamber.make_safe(25.0).verified
    assert bench.chamber.read_foreign_changes() == ()


@pytest.mark.parametrize(("temp_c", "rate"), [(30.0, 1.0), (-20.07, 0.7), (23.4, 1.0), (85.0, 5.0)])
def test_a_ramp_is_never_foreign_under_way_or_ended(bench, temp_c, rate):
    bench.chamber.ramp_to_c(temp_c, rate)
    for _ in range(40):
        assert bench.chamber.read_foreign_changes() == ()
        bench.wait(120.0)
    bench.chamber.hold_temp_c(25.0)
    assert bench.chamber.read_foreign_changes() == ()


def test_ramp_after_ramp_is_not_foreign(bench):
    for temp_c in (40.0, 20.0, 60.0):
        bench.chamber.ramp_to_c(temp_c, 2.0)
        assert bench.chamber.read_foreign_changes() == ()
        bench.wait(300.0)
        assert bench.chamber.read_foreign_changes() == ()


def test_a_set_point_changed_at_the_panel_is_told_and_a_command_settles_it(bench):
    bench.chamber.hold_temp_c(60.0)
    bench.panel.operate("setpoint_changed")
    assert bench.chamber.read_foreign_changes() == ("set point 80 °C, commanded 60 °C",)
    bench.chamber.hold_temp_c(60.0)
    assert bench.chamber.read_foreign_changes() == ()


def test_a_set_point_changed_in_a_ramp_is_told_of_those_that_ramp_by_it(bench):
    bench.chamber.ramp_to_c(60.0, 1.0)
    bench.wait(120.0)
    bench.panel.operate("setpoint_changed", 80.0)
    # the F4 ramps by a profile, to which the static set point means nothing
    told = () if bench.model == "watlow_f4" else ("set point 80 °C, commanded 60 °C",)
    assert bench.chamber.read_foreign_changes() == told


def test_a_profile_started_by_somebody_is_told(bench):
    bench.chamber.hold_temp_c(60.0)
    bench.panel.operate("foreign_profile", 70.0)
    told = {
        "watlow_f4t": "profile runs, none commanded",
        "watlow_f4": "profile 40 runs, none commanded",
        "eurotherm_3504": "program runs, none commanded",
    }
    assert bench.chamber.read_foreign_changes() == (told[bench.model],)
    assert bench.chamber.make_safe(25.0).verified
    assert bench.chamber.read_foreign_changes() == ()
    assert bench.chamber.read_setpoint_c() == pytest.approx(25.0, abs=0.05)


@pytest.mark.parametrize(
    ("model", "address", "word", "told"),
    [
        ("watlow_f4t", 2730, 62, "control mode off, commanded auto"),
        ("watlow_f4t", 2730, 54, "control mode manual, commanded auto"),
        ("watlow_f4t", 2794, 62, "ramp action off, commanded setpoint"),
        ("watlow_f4t", 2796, 39, "ramp scale per_hour, commanded per_minute"),
        ("eurotherm_3504", 273, 1, "control mode manual, commanded auto"),
        ("eurotherm_3504", 35, 30, "ramp rate 3 °C/min, commanded 1 °C/min"),
        ("eurotherm_3504", 78, 1, "ramp disable no_ramp, commanded ramp"),
    ],
)
def test_each_register_changed_in_a_ramp_is_told(make_bench, model, address, word, told):
    bench = make_bench(model)
    bench.chamber.ramp_to_c(60.0, 1.0)
    bench.set_register(address, word)
    assert bench.chamber.read_foreign_changes() == (told,)


def test_the_f4s_own_profile_ended_by_somebody_or_another_in_its_place_is_told(make_bench):
    bench = make_bench("watlow_f4")
    bench.chamber.ramp_to_c(60.0, 1.0)
    bench.wait(60.0)
    bench.set_register(1217, 1)
    assert bench.chamber.read_foreign_changes() == ("set point 23.4 °C, commanded 60 °C",)
    bench.chamber.ramp_to_c(60.0, 1.0)
    bench.panel.operate("foreign_profile", 70.0)
    assert bench.chamber.read_foreign_changes() == ("profile 40 runs, profile 1 commanded",)


def test_a_look_is_few_questions(bench):
    bench.chamber.ramp_to_c(60.0, 1.0)
    before = bench.chamber.counters.exchanges
    bench.chamber.read_foreign_changes()
    assert bench.chamber.counters.exchanges - before <= 6


def test_a_foreign_f4t_whose_operator_changes_things_is_told(drive):
    bank = ForeignF4T()
    chamber = drive(bank)
    chamber.hold_temp_c(60.0)
    assert chamber.read_foreign_changes() == ()
    bank.setpoint_c = 80.0
    bank.mode = 62
    assert sorted(chamber.read_foreign_changes()) == [
        "control mode off, commanded auto",
        "set point 80 °C, commanded 60 °C",
    ]


# ---- a loop found off


def test_a_loop_found_off_is_left_off_and_its_set_point_made_safe(make_bench):
    bench = make_bench("watlow_f4t")
    bench.chamber.hold_temp_c(60.0)
    bench.wait(3600.0)
    bench.panel.operate("loop_off")
    result = bench.chamber.make_safe(25.0)
    assert result.verified, result.steps
    assert result.commanded
    assert "loop: off, left off" in result.steps
    assert bench.panel.memory["mode"] == 62
    bench.wait(7200.0)
    assert bench.chamber.read_temp_c() == pytest.approx(23.0, abs=0.1), "where the room is"
    bench.set_register(2730, 10)  # who switches it on gets 25 °C and not 60
    bench.wait(600.0)
    assert bench.chamber.read_temp_c() == pytest.approx(25.0, abs=0.1)


def test_a_loop_found_off_is_left_off_by_a_driver_that_never_saw_it_on(drive):
    bank = ForeignF4T(mode=62)
    chamber = drive(bank)
    assert chamber.read_occupation() == ("loop is off",)
    result = chamber.make_safe(25.0)
    assert result.verified, result.steps
    assert bank.mode == 62
    assert bank.setpoint_c == 25.0
    chamber.hold_temp_c(30.0)  # a command, by whoever takes the chamber over, is obeyed
    assert bank.mode == 10


def test_a_loop_switched_off_between_two_commands_is_not_switched_on_by_the_second(make_bench):
    bench = make_bench("watlow_f4t")
    bench.chamber.hold_temp_c(60.0)
    bench.panel.operate("loop_off")
    for command in (
        lambda: bench.chamber.hold_temp_c(30.0),
        lambda: bench.chamber.ramp_to_c(30.0, 1.0),
    ):
        with pytest.raises(DeviceError, match="was switched off at the controller since"):
            command()
    assert bench.panel.memory["mode"] == 62
    assert bench.panel.static_c == 60.0
    bench.set_register(2730, 10)  # by somebody who is done
    bench.chamber.hold_temp_c(30.0)
    assert bench.chamber.read_foreign_changes() == ()


@pytest.mark.parametrize("model", ["watlow_f4t", "eurotherm_3504"])
def test_a_loop_found_in_manual_goes_to_automatic(make_bench, model):
    bench = make_bench(model)
    bench.set_register(*{"watlow_f4t": (2730, 54), "eurotherm_3504": (273, 1)}[model])
    result = bench.chamber.make_safe(25.0)
    assert result.verified, result.steps
    assert bench.chamber.read_occupation() == ()


# ---- the panel of an emulated station


def test_the_panel_of_an_emulated_station_is_worked_by_call_and_by_plan():
    clock = SteppedClock(100.0)
    faults = [
        {"device": "chamber", "kind": "setpoint_changed", "at_s": 60.0, "temp_c": 70.0},
        {"device": "chamber", "kind": "loop_off", "at_s": 120.0},
    ]
    wanted = station_config(emulation={"faults": faults})
    with EmulatedStation(wanted, BenchPlant(), clock) as emulated:
        chamber = open_chamber(emulated.config.chamber.model_copy(update={"timeout_s": 5.0}))
        chamber.identify()
        chamber.hold_temp_c(60.0)
        assert chamber.read_foreign_changes() == ()
        clock.sleep_until_s(170.0)
        assert chamber.read_foreign_changes() == ("set point 70 °C, commanded 60 °C",)
        clock.sleep_until_s(230.0)
        assert "control mode off, commanded auto" in chamber.read_foreign_changes()
        emulated.operator("foreign_profile", 50.0)
        assert "profile runs, none commanded" in chamber.read_foreign_changes()
        emulated.inject("chamber", "setpoint_changed", temp_c=65.0)
        assert "set point 65 °C, commanded 60 °C" in chamber.read_foreign_changes()
        chamber.close()
    with pytest.raises(RuntimeError, match="not started"):
        emulated.operator("loop_off")


def test_what_a_model_cannot_show_is_refused():
    faults = [{"device": "chamber", "kind": "loop_off", "at_s": 1.0}]
    with pytest.raises(ValueError, match="no register that tells loop_off"):
        station_config(chamber={"model": "watlow_f4"}, emulation={"faults": faults})
    with (
        EmulatedStation(
            station_config(chamber={"model": "watlow_f4"}), BenchPlant(), SteppedClock()
        ) as emulated,
        pytest.raises(ValueError, match="no register that tells"),
    ):
        emulated.operator("loop_off")
