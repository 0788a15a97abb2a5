"""Controllers that are not what the station file says, and how they are served."""

import struct

from tests.drivers.chambers.foreign_controllers import ForeignF4, ForeignF4T

CALLS = {
    "identify": lambda chamber: chamber.identify(),
    "hold": lambda chamber: chamber.hold_temp_c(25.0),
    "ramp": lambda chamber: chamber.ramp_to_c(40.0, 1.0),
}


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
        ForeignF4, {"limits_c": (180.0, -70.0)}, None, {}, "expected the high 5 °C above the low"),
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
