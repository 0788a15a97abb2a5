"""Nothing is written to a controller that was not shown to be the station file's."""

import json

import pytest

from drivers.chambers.open import open_chamber
from drivers.clock import SteppedClock
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import FaultPlan
from drivers.errors import DeviceError, FencedError, RecognitionError
from drivers.station import ChamberConfig
from tests.drivers.chambers.foreign_controllers import ForeignF4, ForeignF4T
from tests.drivers.chambers.strangers import CALLS, STRANGERS, odd
from tests.drivers.ideal_plant import IdealPlant


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
