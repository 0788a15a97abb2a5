"""Nothing is written to a controller that was not shown to be the station file's."""

import contextlib
import json
import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.chambers import watch as chamber_watch
from drivers.chambers.open import open_chamber
from drivers.chambers.recognition import find_problem, swap_words
from drivers.clock import SteppedClock
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import FaultPlan
from drivers.errors import DeviceError, FencedError, LimitError, RecognitionError
from drivers.station import ChamberConfig
from tests.drivers.chambers.foreign_controllers import ForeignF4, ForeignF4T
from tests.drivers.ideal_plant import IdealPlant

CALLS = {
    "identify": lambda chamber: chamber.identify(),
    "hold": lambda chamber: chamber.hold_temp_c(25.0),
    "ramp": lambda chamber: chamber.ramp_to_c(40.0, 1.0),
}


@pytest.fixture
def serve():
    """Return a function that starts a foreign controller, and one that opens a driver on it."""
    started = []

    def make(kind, **settings):
        started.append(kind(**settings))
        return started[-1]

    def drive(bank, **more):
        model = "watlow_f4" if isinstance(bank, ForeignF4) else "watlow_f4t"
        keys = ("permit", "recognition")
        given = {k: more.pop(k) for k in keys if k in more}
        chamber = open_chamber(
            ChamberConfig(model=model, url=bank.url, timeout_s=5.0, **more), **given
        )
        started.append(chamber)
        return chamber

    make.drive = drive
    yield make
    for one in reversed(started):
        one.close()


def odd(address, *words):
    """Return a controller's setting: these words at an address, whatever its state."""

    def spoil(bank):
        bank.odd[address] = list(words)

    return spoil


def high_words(number):
    return struct.unpack(">HH", struct.pack(">f", number))


# kind, its settings, what is odd about it, the station file's keys, what is told
STRANGERS = {
    "F4 with 0 decimals": (ForeignF4, {"decimals": 0}, None, {}, "shows 0 decimals, expected 1"),
    "F4 with 2 decimals": (ForeignF4, {"decimals": 2}, None, {}, "shows 2 decimals, expected 1"),
    "F4 in °F": (ForeignF4, {"fahrenheit": True}, None, {}, "works in °F"),
    "F4 in an unknown unit": (ForeignF4, {}, odd(901, 7), {}, "shows unit 7 at 901"),
    "F4 without decimals": (ForeignF4, {"without": [606]}, None, {}, "decimals at 606: refused"),
    "F4 without a unit": (ForeignF4, {"without": [901]}, None, {}, "units at 901: refused"),
    "F4 without a limit": (ForeignF4, {"without": [603]}, None, {}, "at 603: refused"),
    "F4 with limits the wrong way round": (
        ForeignF4, {"limits_c": (180.0, -70.0)}, None, {}, "expected low below high"),
    "F4 with a limit that is none": (ForeignF4, {}, odd(603, 9999), {}, "limit 999.9, expected"),
    "F4 with a broken sensor": (ForeignF4, {}, odd(100, 9999), {}, "temperature 999.9, expected"),
    "F4 too hot for its limits": (
        ForeignF4, {"limits_c": (-70.0, 60.0)}, odd(100, 900), {}, "temperature 90, expected"),
    "F4T high word first": (
        ForeignF4T, {"high_first": True}, None, {}, "floats come high word first"),
    "F4T low word first": (ForeignF4T, {}, None, {"word_order": "high"}, "come low word first"),
    "F4T whose port is in °F": (
        ForeignF4T, {"fahrenheit": True}, odd(1328, 15), {}, "Modbus port works in °F"),
    "F4T in °F by its display": (
        ForeignF4T, {"without": [6730]}, odd(1328, 30), {}, "display is in °F"),
    "F4T that tells no unit": (
        ForeignF4T, {"without": [6730, 1328]}, None, {}, 'confirmed = "Modbus in °C"'),
    "F4T confirmed otherwise": (
        ForeignF4T, {"without": [6730, 1328]}, None, {"confirmed": "yes"}, 'it has "yes"'),
    "F4T without a limit": (ForeignF4T, {"without": [2774]}, None, {}, "at 2774: refused"),
    "F4T with a broken sensor": (
        ForeignF4T, {}, odd(2820, 0, 0x7FC0), {}, "temperature nan, expected"),
    "F4T with a subnormal set point": (
        ForeignF4T, {}, odd(2782, 0x41C8, 0), {}, "set point 2.35.*other order"),
    "F4T with an infinite limit": (ForeignF4T, {}, odd(2776, 0, 0x7F80), {}, "limit inf, expected"),
    "F4T that goes by another set point": (
        ForeignF4T, {}, odd(2810, *high_words(70.0)[::-1]), {}, "goes by 70 °C, its set point"),
}  # fmt: skip


@pytest.fixture(params=STRANGERS)
def stranger(request, serve):
    kind, settings, spoil, file, told = STRANGERS[request.param]
    bank = serve(kind, **settings)
    if spoil is not None:
        spoil(bank)
    return bank, (lambda **more: serve.drive(bank, **file, **more)), told


def test_a_stranger_is_told_and_gets_nothing_written(stranger):
    bank, drive, told = stranger
    chamber = drive()
    with pytest.raises(RecognitionError, match=told) as caught:
        chamber.identify()
    assert str(caught.value).startswith("chamber: ")
    assert "\n" not in str(caught.value)
    for call in CALLS.values():
        with pytest.raises(RecognitionError, match="nothing was sent"):
            call(chamber)
    assert chamber.recognition == {}
    assert chamber.read_foreign_changes() == ()
    assert bank.writes == []


def test_a_stranger_is_not_made_safe_and_the_result_says_so(stranger):
    bank, drive, _ = stranger
    for chamber in (drive(), drive()):
        for _ in range(2):
            result = chamber.make_safe(25.0)
            assert not result.verified
            assert not result.commanded
            assert [step.startswith("not commanded: chamber: ") for step in result.steps] == [True]
    assert bank.writes == []


def test_floats_that_make_sense_in_both_orders_are_refused(serve):
    bank = serve(ForeignF4T)
    for address, half in (
        (2774, 0xC25C),
        (2776, 0x42AA),
        *((a, 0x41C8) for a in (2782, 2810, 2820)),
    ):
        bank.odd[address] = [half, half]
    for order in ("low", "high"):
        chamber = serve.drive(bank, word_order=order)
        with pytest.raises(RecognitionError, match="make sense in either word order"):
            chamber.identify()
        assert not chamber.make_safe(25.0).commanded
    assert bank.writes == []


# ---- what is recognised


FRIENDS = {
    "F4": (ForeignF4, {}, None, {}),
    "F4 with 0 decimals": (ForeignF4, {"decimals": 0}, None, {"decimals": 0}),
    "F4T": (ForeignF4T, {}, None, {}),
    "F4T high word first": (ForeignF4T, {"high_first": True}, None, {"word_order": "high"}),
    "F4T whose display alone is in °F": (ForeignF4T, {}, odd(1328, 30), {}),
    "F4T that tells the unit of the display only": (ForeignF4T, {"without": [6730]}, None, {}),
    "F4T confirmed": (
        ForeignF4T, {"without": [6730, 1328]}, None, {"confirmed": "Modbus in °C"}),
    "F4T in the cold": (ForeignF4T, {"temp_c": -55.25}, None, {}),
}  # fmt: skip


@pytest.mark.parametrize("friend", FRIENDS)
def test_a_friend_is_recognised_and_goes_where_it_is_sent(friend, serve):
    kind, settings, spoil, file = FRIENDS[friend]
    bank = serve(kind, **settings)
    if spoil is not None:
        spoil(bank)
    chamber = serve.drive(bank, **file)
    assert "set points -55 to 85 °C" in chamber.identify()
    assert bank.writes == []
    chamber.hold_temp_c(30.0)
    assert bank.setpoint_c == pytest.approx(30.0)
    result = serve.drive(bank, **file).make_safe(25.0)  # a driver that recognises for itself
    assert result.verified, result.steps
    assert result.commanded
    assert bank.setpoint_c == pytest.approx(25.0)


def test_a_unit_changed_at_the_panel_ends_all_commands(serve):
    bank = serve(ForeignF4)
    chamber = serve.drive(bank)
    chamber.identify()
    chamber.hold_temp_c(30.0)
    bank.fahrenheit = True
    written = len(bank.writes)
    with pytest.raises(RecognitionError, match="works in °F"):
        chamber.hold_temp_c(40.0)
    result = chamber.make_safe(25.0)
    assert (result.verified, result.commanded) == (False, False)
    assert len(bank.writes) == written


def test_a_word_order_changed_at_the_panel_ends_all_commands(serve):
    bank = serve(ForeignF4T)
    chamber = serve.drive(bank)
    chamber.identify()
    chamber.hold_temp_c(30.0)
    bank.high_first = True
    written = len(bank.writes)
    with pytest.raises(RecognitionError, match="words come in the other order"):
        chamber.hold_temp_c(40.0)
    assert not chamber.make_safe(25.0).commanded
    assert len(bank.writes) == written


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (ForeignF4, {"decimals": 2}),
        (ForeignF4, {"fahrenheit": True}),
        (ForeignF4T, {"fahrenheit": True}),
        (ForeignF4T, {"high_first": True}),
    ],
)
def test_no_temperature_is_read_by_a_scale_changed_at_the_panel(kind, change, serve):
    # 22.5 °C: 225 and, with the words of its float swapped, 2.3e-41 are numbers like others
    bank = serve(kind, temp_c=22.5)
    chamber = serve.drive(bank)
    assert chamber.read_temp_c() == pytest.approx(22.5)  # before anything is known of it
    chamber.identify()
    assert chamber.read_temp_c() == pytest.approx(22.5)
    for name, value in change.items():
        setattr(bank, name, value)
    with pytest.raises(RecognitionError):
        chamber.read_temp_c()


def test_limits_changed_at_the_panel_do_not_keep_a_chamber_from_being_made_safe(serve):
    for kind in (ForeignF4, ForeignF4T):
        bank = serve(kind)
        chamber = serve.drive(bank)
        chamber.identify()
        chamber.hold_temp_c(60.0)
        bank.limits_c = (-40.0, 100.0)
        result = chamber.make_safe(25.0)
        assert result.verified, result.steps


# ---- evidence from another process


@pytest.mark.parametrize("kind", [ForeignF4, ForeignF4T])
def test_evidence_makes_safe_a_chamber_whose_sensor_broke_since(kind, serve):
    bank = serve(kind)
    first = serve.drive(bank)
    first.identify()
    evidence = json.loads(json.dumps(dict(first.recognition)))
    bank.odd[{ForeignF4: 100, ForeignF4T: 2820}[kind]] = [9999, 0x7FC0]
    assert not serve.drive(bank).make_safe(25.0).commanded, "without it nothing is shown"
    assert bank.writes == []
    other = serve.drive(bank, recognition=evidence)
    with pytest.raises(DeviceError, match="broken sensor"):
        other.identify()
    result = serve.drive(bank, recognition=evidence).make_safe(25.0)
    assert result.verified, result.steps
    assert bank.setpoint_c == pytest.approx(25.0)


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (ForeignF4, {"decimals": 2}),
        (ForeignF4, {"fahrenheit": True}),
        (ForeignF4, {"limits_c": (-70.0, 150.0)}),
        (ForeignF4T, {"limits_c": (-40.0, 180.0)}),
        (ForeignF4T, {"fahrenheit": True}),
        (ForeignF4T, {"high_first": True}),
    ],
    ids=str,
)
def test_evidence_that_differs_keeps_everything_from_being_sent(kind, change, serve):
    bank = serve(kind)
    first = serve.drive(bank)
    first.identify()
    for name, value in change.items():
        setattr(bank, name, value)
    other = serve.drive(bank, recognition=first.recognition)
    with pytest.raises(RecognitionError):
        other.identify()
    result = serve.drive(bank, recognition=first.recognition).make_safe(25.0)
    assert (result.verified, result.commanded) == (False, False)
    assert bank.writes == []


def test_evidence_of_another_model_or_scaling_is_none(serve):
    f4, f4t = serve(ForeignF4), serve(ForeignF4T)
    chamber = serve.drive(f4)
    chamber.identify()
    with pytest.raises(RecognitionError, match="model is Watlow F4T, was Watlow F4 when"):
        serve.drive(f4t, recognition=chamber.recognition).identify()
    assert f4t.writes == []


# ---- the permit


def test_every_write_asks_for_the_permit_and_none_is_sent_without(serve):
    bank = serve(ForeignF4T)
    asked = []
    chamber = serve.drive(bank, permit=lambda: asked.append(len(bank.writes)))
    chamber.identify()
    assert asked == []
    chamber.hold_temp_c(30.0)
    chamber.ramp_to_c(40.0, 1.0)
    assert chamber.make_safe(25.0).verified
    assert asked == list(range(len(bank.writes))), "once before each"


@pytest.mark.parametrize("left", range(4))
def test_a_permit_withdrawn_stops_the_next_write_and_the_result_tells_what_went_out(left, serve):
    bank = serve(ForeignF4T)

    def permit():
        if len(bank.writes) >= left:
            raise FencedError("the guardian has taken over")

    chamber = serve.drive(bank, permit=permit)
    chamber.identify()
    result = chamber.make_safe(25.0)
    assert len(bank.writes) == min(left, 3)
    assert result.commanded == (left > 0)
    if left < 3:
        assert not result.verified
        assert "the guardian has taken over" in result.steps[-1]
        with pytest.raises(FencedError):
            chamber.hold_temp_c(30.0)


def test_a_repeated_write_asks_again():
    clock = SteppedClock()
    faults = FaultPlan([], "chamber", clock)
    with ChamberEmulator("watlow_f4", IdealPlant(), clock, faults) as emulator:
        asked = []

        def permit():
            asked.append(1)
            if len(asked) == 1:
                faults.inject("dropped_connection")
            elif len(asked) == 2:
                raise FencedError("taken over")

        config = ChamberConfig(model="watlow_f4", url=emulator.url, timeout_s=5.0)
        chamber = open_chamber(config, permit=permit)
        chamber.identify()
        with pytest.raises(FencedError):
            chamber.hold_temp_c(40.0)
        assert len(asked) == 2, "and no third time: a permit withdrawn is no fault of the line"
        chamber.close()


# ---- any combination


def controllers():
    """Return what an emulated controller is set to, and what its station file says."""
    return st.fixed_dictionaries(
        {
            "model": st.sampled_from(["watlow_f4", "watlow_f4t", "eurotherm_3504"]),
            "decimals": st.tuples(st.integers(0, 2), st.integers(0, 3)),
            "word_order": st.tuples(*2 * (st.sampled_from(["low", "high"]),)),
            "fahrenheit": st.booleans(),
            "temp_c": st.floats(-50.0, 80.0).map(lambda t: round(t, 1)),
        }
    )


def is_wrong(case) -> bool:
    """Tell whether the station file errs about what matters for the model."""
    if case["model"] == "watlow_f4t":
        return case["fahrenheit"] or case["word_order"][0] != case["word_order"][1]
    wrong = case["decimals"][0] != case["decimals"][1]
    return wrong or (case["model"] == "watlow_f4" and case["fahrenheit"])


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(case=controllers())
def test_no_write_leaves_for_any_wrong_scale_unit_or_word_order(case):
    clock = SteppedClock()
    emulator = ChamberEmulator(
        case["model"], IdealPlant(air_c=case["temp_c"]), clock, FaultPlan([], "chamber", clock),
        decimals=case["decimals"][0], word_order=case["word_order"][0],
    )  # fmt: skip
    emulator.controller.fahrenheit = case["fahrenheit"]
    writes = []
    store = emulator.controller.write
    emulator.controller.write = lambda *words: (writes.append(words), store(*words))
    with emulator:
        config = ChamberConfig(
            model=case["model"], url=emulator.url, timeout_s=5.0,
            decimals=case["decimals"][1], word_order=case["word_order"][1],
        )  # fmt: skip
        for call in [*CALLS.values(), lambda chamber: chamber.make_safe(25.0)]:
            chamber = open_chamber(config)
            with contextlib.suppress(
                RecognitionError, LimitError
            ):  # 40 °C has no room for 3 decimals
                call(chamber)
            chamber.close()
    # every driver here is a new one: of a friend, only `make_safe` writes
    assert not (is_wrong(case) and writes)
    small = (
        case["model"] == "eurotherm_3504" and abs(case["temp_c"]) * 10 ** case["decimals"][1] < 25
    )
    assert is_wrong(case) or small or writes


@given(
    lo=st.integers(-1000, 0).map(lambda n: n / 10),
    hi=st.integers(10, 3000).map(lambda n: n / 10),
    temp_c=st.floats(-50.0, 80.0, width=32),
)
def test_limits_of_whole_tenths_never_make_sense_with_their_words_swapped(lo, hi, temp_c):
    """They are what is always there to tell the order by, whatever the temperature."""
    assert find_problem((swap_words(lo), swap_words(hi)), {"temperature": swap_words(temp_c)})
    assert not find_problem((lo, hi), {"set point": 0.5 * (lo + hi)})


def test_swapping_twice_is_nothing():
    for number in (23.4, -55.0, 0.0):
        assert swap_words(swap_words(number)) == pytest.approx(number, rel=1e-7)


# ---- what no register shows: the 3504 without floats


class WithoutFloats(ChamberEmulator):
    """A 3504 that knows its scaled integers only."""

    def start(self) -> None:
        cells = self.controller._owner
        for address in range(0x8000, 0x8010):
            cells.pop(address, None)
        super().start()


@pytest.mark.parametrize("confirmed", [None, "decimals = 2, °C", "decimals = 1, °C"])
def test_a_3504_without_floats_must_be_confirmed_for_its_decimals(confirmed):
    clock = SteppedClock()
    plant = IdealPlant(air_c=23.4)
    with WithoutFloats("eurotherm_3504", plant, clock, FaultPlan([], "chamber", clock)) as emulator:
        config = ChamberConfig(
            model="eurotherm_3504", url=emulator.url, timeout_s=5.0, confirmed=confirmed
        )
        chamber = open_chamber(config)
        if confirmed == "decimals = 1, °C":
            assert "23.4 °C" in chamber.identify()
            assert chamber.make_safe(25.0).verified
        else:
            with pytest.raises(RecognitionError) as caught:
                chamber.identify()
            said = str(caught.value)
            assert "it reads 23.4 °C, set point 23.4 °C" in said
            assert 'put confirmed = "decimals = 1, °C" into [chamber]' in said
            assert not chamber.make_safe(25.0).commanded
        chamber.close()


def test_a_set_point_that_the_loop_does_not_go_by_is_an_error_of_the_command(serve, monkeypatch):
    monkeypatch.setattr(chamber_watch, "FOLLOW_S", 0.05)  # it never will
    bank = serve(ForeignF4T)
    chamber = serve.drive(bank)
    chamber.identify()
    bank.odd[2810] = bank.floats(23.4)
    with pytest.raises(DeviceError, match=r"goes by 23.4 °C, expected 60 °C"):
        chamber.hold_temp_c(60.0)
