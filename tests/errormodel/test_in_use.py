import pytest

from errormodel.in_use import InUse


def raise_inside(known: InUse[str]) -> None:
    with known.using("inner"):
        raise LookupError(known())


def test_a_value_is_in_use_until_its_block_ends_however_it_ends():
    known = InUse("standard")
    with known.using("mine"):
        assert known() == "mine"
        with pytest.raises(LookupError, match="inner"):
            raise_inside(known)
        assert known() == "mine"
    assert known() == "standard"
