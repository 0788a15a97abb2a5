"""Values in registers: there and back, whatever the scale, the sign and the order of words."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.chambers.maps import Register, load_map

MODELS = ("watlow_f4t", "watlow_f4", "eurotherm_3504")
orders = st.sampled_from(("low", "high"))


@settings(deadline=None)  # how busy the machine is proves nothing
@given(st.integers(-32768, 32767), st.integers(0, 3))
def test_scaled_int16_there_and_back(raw, decimals):
    register = Register(address=1, scale="decimals")
    words = register.encode(raw / 10**decimals, decimals)
    assert words == (raw & 0xFFFF,)
    assert register.decode(words, decimals) == raw / 10**decimals


@settings(deadline=None)  # how busy the machine is proves nothing
@given(st.floats(width=32, allow_nan=False, allow_infinity=False), orders)
def test_float32_there_and_back(value, order):
    register = Register(address=1, kind="float32", word_order=order)
    words = register.encode(value)
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    assert words == ((low, high) if order == "low" else (high, low))
    assert register.decode(words) == value


@settings(deadline=None)  # how busy the machine is proves nothing
@given(st.integers(-(2**31), 2**31 - 1), orders)
def test_int32_there_and_back(value, order):
    register = Register(address=1, kind="int32", word_order=order)
    assert register.decode(register.encode(value)) == value


@settings(deadline=None)  # how busy the machine is proves nothing
@given(st.integers(0, 2**32 - 1), orders)
def test_uint32_there_and_back(value, order):
    register = Register(address=1, kind="uint32", word_order=order)
    assert register.decode(register.encode(value)) == value


@settings(deadline=None)  # how busy the machine is proves nothing
@given(st.floats(-3276.0, 3276.0))
def test_rounding_stays_inside_the_tolerance(value):
    register = Register(address=1, scale="decimals")
    assert abs(register.decode(register.encode(value, 1), 1) - value) <= register.tolerance(1)


@pytest.mark.parametrize(
    ("kind", "value"),
    [("int16", 3276.8), ("int16", -3276.9), ("uint16", -0.1), ("uint16", 6553.6),
     ("int16", math.nan), ("float32", math.inf), ("float32", 1e39), ("uint32", -1.0)],
)  # fmt: skip
def test_what_does_not_fit_is_refused(kind, value):
    with pytest.raises(ValueError, match=r"does not fit|no value"):
        Register(address=1, kind=kind, scale=10.0).encode(value)


def test_a_wrong_number_of_words_is_refused():
    with pytest.raises(ValueError, match="takes 2 registers, got 1"):
        Register(address=1, kind="float32").decode((1,))


@pytest.mark.parametrize("model", MODELS)
def test_the_maps_that_are_shipped(model):
    register_map = load_map(model)
    taken = [
        (r.address + i, name) for name, r in register_map.registers.items() for i in range(r.count)
    ]
    assert len({address for address, _ in taken}) == len(taken), "no two values overlap"
    usual = {r.count for r in register_map.registers.values()} | {10}
    assert not usual & set(register_map.barrier.counts), "the barrier's length is its own"
    assert register_map["setpoint"].access == "rw"
    assert register_map["temperature"].count in (1, 2)


def test_an_unknown_model_has_no_map():
    with pytest.raises(ValueError, match="no register map"):
        load_map("binder")
