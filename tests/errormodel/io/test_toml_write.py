import tomllib

from hypothesis import given
from hypothesis import strategies as st

from errormodel.io.toml import MAX_LINE, parse_toml
from errormodel.io.toml_write import toml_text

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
SCALARS = TEXTS | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=12,
)


@given(st.dictionaries(TEXTS, VALUES, max_size=6))
def test_every_value_reads_back_equal(data):
    assert tomllib.loads(toml_text(data)) == data


def test_a_comment_stands_above_its_table_and_beside_its_item():
    data = {"terms": ["k0", "k1"], "effects": {"sag": {"k2": 1.0}, "creep": {"k3": 2.0}}}
    comments = {("terms", "k1"): "scale", ("effects", "sag"): "two\nlines", ("effects",): "nowhere"}
    text = toml_text(data, comments)
    assert text == (
        'terms = [\n    "k0",\n    "k1",  # scale\n]\n'
        "\n# two\n# lines\n[effects.sag]\nk2 = 1.0\n"
        "\n[effects.creep]\nk3 = 2.0\n"
    )
    assert tomllib.loads(text) == data


def test_no_line_is_longer_than_the_reader_takes():
    many = [{"serial": f"QA-{k:04}", "nominal_scale": 1.3} for k in range(1000)]
    data = {"accelerometers": many, "self_heating": {"time_min": [k / 7 for k in range(20_000)]}}
    text = toml_text(data)
    assert max(map(len, text.split("\n"))) < MAX_LINE
    assert parse_toml(text, "sequence") == data
