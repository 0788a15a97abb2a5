"""The demonstration's own recording: whatever model it is held against, no wrong name."""

import pytest

from thermo.twin.accelerometer import emulated_accelerometer

# what the emulated accelerometers have beside bias and scale factor quadratic in temperature
TRUE = {
    "bias_temperature_order", "scale_temperature_order", "second_order", "third_order",
    "cross_axis",
}  # fmt: skip
LOOP = "bias_hysteresis"


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_no_model_of_the_demonstration_gives_a_wrong_name(call, tmp_path):
    assert call("demo", "--out", tmp_path / "demo", "--json").code == 0
    folder = tmp_path / "demo/001"
    for model in ((), ("--model", "bare"), ("--model", folder / "model.json")):
        done = call("discrepancy", "thermal", folder / "run.csv", *model, "--json")
        said = {a["serial"]: a for a in done.document["accelerometers"]}
        assert done.document["shared"] == []
        for serial, one in said.items():
            aliased = {n for names in one["alias_sets"] for n in names}
            bare = {e["name"] for e in one["effects"]} - aliased
            true = TRUE | ({LOOP} if serial == "QA-003" else set())
            assert bare <= true, (model, serial)
            if "bare" in model:
                assert {"k2", "delta_o"} <= set(one["fit_first"]), serial
            elif serial != "QA-003":
                assert one["verdict"] == "nothing", (model, serial)
        truth_ug = 1e6 * emulated_accelerometer("QA-003").values[LOOP]
        (loop,) = [e for e in said["QA-003"]["effects"] if e["name"] == LOOP]
        found = loop["parameters"][LOOP]
        assert abs(abs(found["value"]) - abs(truth_ug)) < 2.0 * found["sigma"], model
