"""A station file that errs about scale, unit or word order lets no write out."""

import contextlib

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from drivers.chambers import watch as chamber_watch
from drivers.chambers.open import open_chamber
from drivers.chambers.recognition import find_problem, swap_words
from drivers.clock import SteppedClock
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import FaultPlan
from drivers.errors import DeviceError, LimitError, RecognitionError
from drivers.station import ChamberConfig
from tests.drivers.chambers.foreign_controllers import ForeignF4T
from tests.drivers.chambers.strangers import CALLS
from tests.drivers.ideal_plant import IdealPlant


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
    hi=st.integers(50, 3000).map(lambda n: n / 10),
    temp_c=st.floats(-50.0, 80.0, width=32),
)
@example(lo=0.0, hi=258.5, temp_c=0.0)
@example(lo=-99.5, hi=298.5, temp_c=0.0)
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
