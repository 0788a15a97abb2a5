"""The form that makes a sequence: its fields, what each means, and the file made from them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from errormodel.errors import InputError
from thermo.planning.sequence import Sequence, sequence_toml


@dataclass(frozen=True, slots=True)
class Field:
    """A field of the form; `start` is what stands in it at first."""

    key: str
    label: str
    start: str
    meaning: str


FIELDS = (
    Field("name", "Name of the test", "night", "Free text; it stands in every list and report."),
    Field(
        "serials",
        "Serial numbers",
        "QA-001, QA-002, QA-003",
        "Those under test, separated by commas, as they are wired in the station.",
    ),
    Field(
        "nominal_scale",
        "Nominal scale factor",
        "1.3",
        "Output unit (mA or V) per g, from the data sheet; K1 is fitted relative to it.",
    ),
    Field("start_c", "Start, °C", "-40", "Chamber temperature at the start of every run."),
    Field("soak_min", "Soak at the start, min", "40", "Before the time of the run begins."),
    Field("far_c", "Far end, °C", "70", "Every run ramps there and back to the start."),
    Field("rate", "Rate, °C/min", "1", "Of both ramps; slow enough for the accelerometers."),
    Field("hold_min", "Hold at the far end, min", "0", "0: the ramp turns at once."),
    Field("runs", "Runs", "2", "Two or more are needed to see how runs differ."),
    Field("rest_h", "Rest between runs, h", "1", "With the accelerometers switched off."),
    Field(
        "angles",
        "Head positions, °",
        "0, 90, 180, 270, 45, 225",
        "Four at right angles separate K0 and K1; two between them show K2 and misalignment.",
    ),
    Field("order", "Order of positions", "random", "random (new in every round) or fixed."),
    Field("period_s", "Time between readings, s", "10", "Equal intervals; a move fits in between."),
    Field("settle_s", "Settling after a move, s", "1", "Before a reading is taken."),
    Field("low_limit_c", "Lowest allowed, °C", "-45", "Chamber and programme; ends the test."),
    Field("high_limit_c", "Highest allowed, °C", "75", "Chamber and programme; ends the test."),
)


def sequence_text(values: Mapping[str, str]) -> str:
    """Return the sequence file that a filled form makes.

    Parameters
    ----------
    values : mapping of str to str
        Text by the keys of `FIELDS`.

    Raises
    ------
    InputError
        With the field's name, if a text is not what the field takes.
    """
    start_c, far_c = _number(values, "start_c"), _number(values, "far_c")
    rate, hold_min = _number(values, "rate"), _number(values, "hold_min")
    segments: list[dict[str, Any]] = [{"kind": "ramp", "to_c": far_c, "rate_c_per_min": rate}]
    if hold_min > 0:
        segments.append({"kind": "hold", "duration_min": hold_min})
    segments.append({"kind": "ramp", "to_c": start_c, "rate_c_per_min": rate})
    serials = [s.strip() for s in values["serials"].split(",") if s.strip()]
    scale = _number(values, "nominal_scale")
    data = {
        "name": values["name"].strip(),
        "accelerometers": [{"serial": s, "nominal_scale": scale} for s in serials],
        "temperature": {
            "start_c": start_c,
            "start_soak_min": _number(values, "soak_min"),
            "repeats": int(_number(values, "runs")),
            "rest_h": _number(values, "rest_h"),
            "segments": segments,
        },
        "positions": {
            "angles_deg": [_as_number(a, "angles") for a in values["angles"].split(",")],
            "order": values["order"].strip(),
        },
        "sampling": {
            "period_s": _number(values, "period_s"),
            "settle_s": _number(values, "settle_s"),
        },
        "limits": {
            "chamber_c": [_number(values, "low_limit_c"), _number(values, "high_limit_c")],
        },
    }
    try:
        return sequence_toml(Sequence.model_validate(data))
    except ValueError as err:
        said = str(err).splitlines()
        raise InputError("the form", said[1] if len(said) > 1 else "", said[-2].strip()) from None


def _number(values: Mapping[str, str], key: str) -> float:
    return _as_number(values[key], key)


def _as_number(text: str, key: str) -> float:
    label = next(f.label for f in FIELDS if f.key == key)
    try:
        return float(text.strip().replace("−", "-"))
    except ValueError:
        raise InputError("the form", label, f"{text!r}, expected a number") from None
