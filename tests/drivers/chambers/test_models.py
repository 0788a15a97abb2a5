import pytest
from pydantic import ValidationError

from drivers.chambers.maps import load_map
from drivers.chambers.modbus_chamber import ModbusChamber
from drivers.chambers.models import CHAMBER_MODELS, import_named
from drivers.emulators.chamber_bank import Controller
from drivers.station import ChamberConfig

URL = "modbus+tcp://192.0.2.1:502"


@pytest.mark.parametrize("name", CHAMBER_MODELS)
def test_a_model_has_a_driver_an_emulator_and_a_map(name):
    classes = CHAMBER_MODELS[name]
    assert issubclass(import_named(classes.driver), ModbusChamber)
    assert issubclass(import_named(classes.emulator), Controller)
    assert load_map(name).registers
    assert ChamberConfig(model=name, url=URL).model == name


def test_a_model_that_is_not_listed_is_refused_with_those_that_are():
    with pytest.raises(ValidationError) as caught:
        ChamberConfig(model="watlow_f5", url=URL)
    assert all(f"'{name}'" in str(caught.value) for name in CHAMBER_MODELS)
