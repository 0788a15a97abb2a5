import pytest

from accelbench.shell.laboratory import read_laboratory
from errormodel.errors import InputError


def test_the_laboratory_is_read_and_what_is_left_out_is_not_given(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_text('[laboratory]\nname = "Lab 3"\ninstruments = ["3458A, 114", "chamber"]\n')
    assert read_laboratory(path).told() == (
        ("Laboratory", "Lab 3"),
        ("Operator", "not given"),
        ("Instruments", "3458A, 114; chamber"),
    )


@pytest.mark.parametrize(
    ("content", "place"),
    [("", "laboratory"), ('[laboratory]\noperater = "x"\n', "operater"), ("[", "not TOML")],
)
def test_a_wrong_key_is_named(tmp_path, content, place):
    path = tmp_path / "lab.toml"
    path.write_text(content)
    with pytest.raises(InputError, match=place):
        read_laboratory(path)
