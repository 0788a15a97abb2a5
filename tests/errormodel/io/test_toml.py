from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field

from errormodel.errors import InputError
from errormodel.io.toml import check, parse_toml


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Hold(Strict):
    kind: Literal["hold"]


class Ramp(Strict):
    kind: Literal["ramp"]


class Head(Strict):
    order: str = "up"


class Config(Strict):
    gravity_m_s2: float
    head: Head = Head()
    parts: list[Annotated[Hold | Ramp, Field(discriminator="kind")]] = []


def complaint(data: dict[str, object]) -> str:
    with pytest.raises(InputError) as caught:
        check(data, Config, "a.toml")
    return str(caught.value)


def test_a_misspelt_key_is_named_with_the_one_that_is_missing():
    assert complaint({"gravity": 9.8}) == (
        "a.toml: gravity_m_s2: Field required; no such key: gravity"
    )


def test_a_key_that_is_none_is_told_the_nearest_also_in_a_table():
    assert complaint({"gravity_m_s2": 9.8, "haed": {}}).endswith("no such key (did you mean head?)")
    assert complaint({"gravity_m_s2": 9.8, "head": {"oder": "up"}}) == (
        "a.toml: head.oder: no such key (did you mean order?)"
    )
    assert complaint({"gravity_m_s2": 9.8, "zzz": 1}) == "a.toml: zzz: no such key"


def test_a_kind_that_is_none_is_told_those_there_are():
    said = complaint({"gravity_m_s2": 9.8, "parts": [{"kind": "hold"}, {"kind": "rampe"}]})
    assert said == "a.toml: parts.1: 'rampe', expected one of 'hold', 'ramp'"


def test_what_is_not_toml_is_told_what_it_should_be():
    with pytest.raises(InputError, match="text must be in quotes"):
        parse_toml("unit = mA", "a.toml")
    with pytest.raises(InputError, match=r"expected a \.toml file"):
        parse_toml("a,b\n1,2", "run.csv")
