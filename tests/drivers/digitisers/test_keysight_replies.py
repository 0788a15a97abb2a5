"""Replies of the 34970A as text: scans, its error queue, whatever else."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from drivers.digitisers.keysight_34970a_scpi import parse_scan, parse_scpi_error
from drivers.errors import ProtocolError

finite = st.floats(-1.2e8, 1.2e8, allow_nan=False)


@given(
    values=st.lists(finite, min_size=1, max_size=20),
    form=st.sampled_from(["+.8E", ".6f", "g", ".3e"]),
)
def test_any_decimal_notation_is_read_as_written(values, form):
    reply = ",".join(f"{format(v, form)},{0.02 * i:013.3f},{101 + i}" for i, v in enumerate(values))
    items = parse_scan(reply)
    assert [i.value for i in items] == [float(format(v, form)) for v in values]
    assert [i.channel for i in items] == [101 + i for i in range(len(values))]


@given(st.text(max_size=80))
def test_no_text_is_taken_for_a_scan_unless_it_is_one(text):
    try:
        items = parse_scan(text)
    except ProtocolError as err:
        assert "\n" not in str(err)  # noqa: PT017  both outcomes are allowed
    else:
        assert len(text.split(",")) == 3 * len(items)


GOOD = "+1.25000000E+00,000000000.040,101,-3.50000000E-03,000000000.080,102"


@example(place=GOOD.index("-"), char=" ")  # the sign lost
@example(place=48, char="\r")  # the last digit of an exponent lost
@given(st.integers(0, len(GOOD) - 1), st.characters(exclude_characters="+-0123456789.E,"))
def test_a_strange_character_anywhere_in_a_scan_is_noticed(place, char):
    broken = GOOD[:place] + char + GOOD[place + 1 :]
    try:
        items = parse_scan(broken)
    except ProtocolError:
        return
    # blanks beside a comma are allowed; "e" is E: neither changes a number
    assert [i.value for i in items] == [1.25, -3.5e-3]


@pytest.mark.parametrize(
    "reply",
    [
        "",
        "+1.25000000E+00",
        "+1.25000000E+00,000000000.040",
        "+1.25000000E+00,000000000.040,101,-3.5E-03",
        "+1.25000000E+00 VDC,000000000.040,101",
        "nan,000000000.040,101",
        "+1.25000000E+00,-1.0,101",
        "+1.25000000E+00,000000000.040,1.01",
        "+1.0E+00,000000000.040,101,+1.0E+00,000000000.050,101",
        "+1.0E+00,000000000.040,101,+1.0E+00,000000000.030,102",
    ],
)
def test_malformed_scans_are_refused(reply):
    with pytest.raises(ProtocolError):
        parse_scan(reply)


@pytest.mark.parametrize(
    ("reply", "expected"),
    [
        ('+0,"No error"', (0, "No error")),
        ('0,"No error"', (0, "No error")),
        ('-113,"Undefined header"', (-113, "Undefined header")),
        ('-222,"Data out of range; nplc"', (-222, "Data out of range; nplc")),
    ],
)
def test_error_queue_replies(reply, expected):
    assert parse_scpi_error(reply) == expected


@pytest.mark.parametrize("reply", ["", "0", "+1.25000000E+00,000000000.040,101", "No error"])
def test_what_is_no_error_queue_reply_is_refused(reply):
    with pytest.raises(ProtocolError):
        parse_scpi_error(reply)
