from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from drivers.station import StationConfig
from errormodel.errors import InputError
from errormodel.io.toml import check, read_toml
from thermo.planning.bounds import SEQUENCE
from thermo.planning.bounds import STATION as STATION_BOUNDS
from thermo.planning.plan import coverage, make_plan, visit_order
from thermo.planning.sequence import Positions, Sequence, load_sequence, parse_sequence
from thermo.planning.text import plan_lines

ROOT = Path(__file__).parents[3]
STATION = read_toml(ROOT / "examples/stations/f4t.toml", StationConfig)
SHORT = (ROOT / "examples/sequences/short.toml").read_text(encoding="utf-8")


def changed(*pairs: tuple[str, str]) -> Sequence:
    text = SHORT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    return parse_sequence(text)


@pytest.mark.parametrize("name", ["overnight", "demo", "short"])
@pytest.mark.parametrize("station", ["f4t", "f4", "3504"])
def test_shipped_sequences_run_on_shipped_stations(name: str, station: str) -> None:
    config = read_toml(ROOT / f"examples/stations/{station}.toml", StationConfig)
    plan = make_plan(load_sequence(ROOT / f"examples/sequences/{name}.toml"), config)
    assert plan.slots > 0
    lines = plan_lines(plan)
    assert all("\n" not in line for line in lines)


def test_short_sequence_by_hand() -> None:
    plan = make_plan(parse_sequence(SHORT), STATION)
    # 2 min + 3 min + 2 min at 15 s
    assert plan.slots == 28
    assert plan.run_s == 420
    assert plan.readings == 28 * 2 * 2
    # twice (5 °C at 1 °C/min + the run) and 0.1 h between
    assert plan.total_s == 2 * (300 + 420) + 360
    run = plan.run(1)
    assert run.segment.tolist() == [0] * 8 + [1] * 12 + [2] * 8
    np.testing.assert_allclose(run.commanded_c[8:20], 20 + 0.5 * np.arange(12), atol=1e-9)
    assert run.position_deg[:5].tolist() == [0, 90, 180, 270, 0]


def test_coverage_counts_every_slot() -> None:
    plan = make_plan(load_sequence(ROOT / "examples/sequences/overnight.toml"), STATION)
    counts = coverage(plan)
    assert sum(counts.values()) == plan.slots * plan.runs
    assert {angle for _, angle in counts} == {45.0 * k for k in range(8)}


@given(
    st.lists(st.integers(-180, 180).map(float), min_size=1, max_size=8, unique=True),
    st.integers(1, 3),
    st.integers(0, 100),
)
def test_every_round_visits_every_position(angles: list[float], times: int, seed: int) -> None:
    positions = Positions(
        angles_deg=tuple(angles), order="random", seed=seed, readings_per_position=times
    )
    length = len(angles) * times
    visits = visit_order(positions, 1, 3 * length + 1).tolist()
    assert len(visits) == 3 * length + 1
    for k in range(3):
        one = visits[k * length : (k + 1) * length]
        assert sorted(one) == sorted(angles * times)
        assert one[::times] == one[times - 1 :: times]  # readings at a position are consecutive


def test_random_order_is_new_each_round_and_run_and_the_same_again() -> None:
    positions = Positions(angles_deg=tuple(float(a) for a in range(12)), order="random", seed=5)

    def first(run: int, count: int = 24) -> list[float]:
        return visit_order(positions, run, count).tolist()

    assert first(1) == first(1)
    assert first(1)[:12] != first(1)[12:]
    assert first(1, 30)[:24] == first(1)
    assert first(1) != first(2)


def test_a_segment_may_have_positions_of_its_own() -> None:
    own = "to_c = 26.0\npositions = {angles_deg = [45.0, 225.0]}"
    run = make_plan(changed(("to_c = 26.0", own)), STATION).run(1)
    assert set(run.position_deg[run.segment == 1]) == {45.0, 225.0}
    assert set(run.position_deg[run.segment != 1]) == {0.0, 90.0, 180.0, 270.0}


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ((("QA-002", "QA-777"),), ("accelerometers.1.serial", "QA-777", "QA-003")),
        ((("to_c = 26.0", "to_c = 90.0"),), ("segment 1", "90", "85")),
        ((("rate_c_per_min = 2.0", "rate_c_per_min = 9.0"),), ("segment 1", "9 °C/min", "5")),
        ((("270.0", "400.0"),), ("positions.angles_deg", "400", "360")),
        # back from 270° to 0° at 40 °/s: 6.75 + 0.5 s; settling 0.5 s; 4 channels of 37 ms
        ((("period_s = 15.0", "period_s = 7.8"),), ("sampling.period_s", "270°", "7.9 s")),
        ((("period_s = 15.0", "period_s = 1e-9"),), ("sampling.period_s", "2000000")),
        ((("period_s = 15.0", "period_s = 1e-320"),), ("sampling.period_s", "inf")),
        ((("rate_c_per_min = 2.0", "rate_c_per_min = 1e-320"),), ("sampling.period_s", "inf")),
        (
            (("[after_gap]", "[limits]\nchamber_c = [-80.0, 50.0]\n[after_gap]"),),
            ("limits.chamber_c", "wider"),
        ),
        (
            (("[after_gap]", "[limits]\naccelerometer_c = [50.0, 60.0]\n[after_gap]"),),
            ("temperature.start_c", "20 °C", "limits.accelerometer_c 50…60"),
        ),
        (
            (("[after_gap]", "[limits]\naccelerometer_c = [0.0, 25.5]\n[after_gap]"),),
            ("segment 1", "26 °C", "limits.accelerometer_c 0…25.5"),
        ),
        # from the safe 25 °C to 20 °C at 0.5 °C/min
        (
            (
                (
                    "start_c = 20.0",
                    "start_c = 20.0\nstart_timeout_min = 9\napproach_c_per_min = 0.5",
                ),
            ),
            ("temperature.start_timeout_min", "9 min", "10 min"),
        ),
    ],
)
def test_what_the_station_cannot_do_is_refused(
    pairs: tuple[tuple[str, str], ...], words: tuple[str, ...]
) -> None:
    with pytest.raises(InputError) as caught:
        make_plan(changed(*pairs), STATION, "seq.toml")
    for word in ("seq.toml", *words):
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("limits.accelerometer_c", "[-55.0, 300.0]"),
        ("limits.max_deviation_c", "1e308"),
        ("limits.max_deviation_min", "1e6"),
        ("limits.stuck_c", "1e308"),
        ("limits.max_failures", "10_000"),
        ("limits.max_failure_s", "1e9"),
        ("temperature.start_timeout_min", "9e4"),
        ("temperature.approach_c_per_min", "1e-6"),
        ("after_gap.max_gap_s", "1e308"),
    ],
)
def test_a_limit_that_protects_nobody_is_refused_but_can_still_be_read(
    key: str, value: str
) -> None:
    section, name = key.split(".")
    base = SHORT + ("\n[limits]\n" if section == "limits" else "")
    sequence = parse_sequence(base.replace(f"[{section}]", f"[{section}]\n{name} = {value}", 1))
    with pytest.raises(InputError) as caught:
        make_plan(sequence, STATION, "seq.toml")
    assert str(caught.value).startswith(f"seq.toml: {key}: ")
    assert "expected" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("section", "changes"),
    [
        ("guardian", {"margin_s": 1e6}),
        ("guardian", {"margin_s": 1e308}),
        ("chamber", {"timeout_s": 60.0, "retries": 10}),
    ],
)
def test_time_outs_that_leave_a_silent_controller_alone_for_hours_are_refused(
    section: str, changes: dict[str, float]
) -> None:
    data = STATION.model_dump()
    data[section] |= changes
    with pytest.raises(
        InputError, match=r"guardian\.margin_s: .* the guardian would act only after .* 1800 s exp"
    ):
        make_plan(parse_sequence(SHORT), StationConfig.model_validate(data), "seq.toml")


# every key of both files that is a number, with a value of its own
EVERY_KEY = """
name = "all"
accelerometers = [{serial = "QA-001", nominal_scale = 1.3, mount_deg = 90.0}]
[temperature]
start_c = 20.0
start_tolerance_c = 0.5
start_soak_min = 1.0
start_timeout_min = 60.0
approach_c_per_min = 1.0
rest_h = 0.1
rest = {temp_c = 25.0}
segments = [
    {kind = "hold", duration_min = 5.0, temp_c = 20.0},
    {kind = "ramp", to_c = 26.0, rate_c_per_min = 2.0},
    {kind = "cycle", low_c = 20.0, high_c = 26.0, rate_c_per_min = 2.0, soak_min = 1.0, count = 1},
]
[positions]
angles_deg = [0.0, 90.0]
readings_per_position = 2
[sampling]
period_s = 15.0
settle_s = 0.5
switch_s = 0.02
[limits]
chamber_c = [0.0, 50.0]
accelerometer_c = [-10.0, 60.0]
[uniformity]
band_c_per_min = 0.1
sins_self_heating = {time_min = [0.0, 10.0], temp_c = [20.0, 25.0]}
[run_in]
k0_limit_ug = 20.0
k1_limit_ppm = 20.0
"""
SELF_HEATING_RATE = "sins_self_heating_rate_c_per_min"  # instead of the table
WITH_FAULT = STATION.model_dump() | {
    "signals": [{"name": "supply_v", "channel": 310}],
    "emulation": {
        "faults": [{"device": "chamber", "kind": "setpoint_changed", "at_s": 1.0}
                   | {"duration_s": 5.0, "temp_c": 30.0}]
    }
}  # fmt: skip


def numbers_in(data: object, place: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Return the place of every number."""
    if isinstance(data, dict):
        return [p for name, value in data.items() for p in numbers_in(value, (*place, name))]
    if isinstance(data, list | tuple):
        return [p for index, value in enumerate(data) for p in numbers_in(value, (*place, index))]
    return [place] if isinstance(data, int | float) and not isinstance(data, bool) else []


def number_keys(kind: object, key: str = "") -> set[str]:
    """Return the key of every number that a file of this kind can hold."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        fields = kind.model_fields.items()
        return {k for n, f in fields for k in number_keys(f.annotation, f"{key}.{n}".lstrip("."))}
    if kind in (int, float):
        return {key}
    return {k for part in get_args(kind) for k in number_keys(part, key)}


def replaced(data: object, place: tuple[str | int, ...], value: float) -> object:
    """Return a copy of nested data with one value exchanged."""
    if not place:
        return value
    first, rest = place[0], place[1:]
    if isinstance(data, dict):
        return data | {first: replaced(data[first], rest, value)}
    assert isinstance(data, list | tuple)
    return [replaced(v, rest, value) if i == first else v for i, v in enumerate(data)]


def accept(kind: type[Sequence] | type[StationConfig], data: object) -> None:
    if kind is Sequence:
        make_plan(check(data, Sequence, "seq.toml"), STATION)
    else:
        make_plan(parse_sequence(EVERY_KEY), check(data, StationConfig, "station.toml"))


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (Sequence, parse_sequence(EVERY_KEY).model_dump(exclude_none=True)),
        (StationConfig, StationConfig.model_validate(WITH_FAULT).model_dump(exclude_none=True)),
    ],
)
def test_no_number_of_a_file_may_be_what_nothing_can_have(
    kind: type[Sequence] | type[StationConfig], data: dict[str, object]
) -> None:
    accept(kind, data)
    places = numbers_in(data)
    keys = {".".join(str(p) for p in place if isinstance(p, str)) for place in places}
    # positions of a segment are checked as the whole sequence's are
    known = {k for k in number_keys(kind) if "segments.positions" not in k}
    assert keys == known - {f"uniformity.{SELF_HEATING_RATE}"}
    for place in places:
        if place[-1] == "seed":  # any number is one
            continue
        number = data
        for step in place:
            number = number[step]
        for value in (2**62, -(2**62)) if isinstance(number, int) else (1e308, -1e308):
            with pytest.raises(InputError) as caught:
                accept(kind, replaced(data, place, value))
            assert "\n" not in str(caught.value), place


@pytest.mark.parametrize(
    ("kind", "bounds"), [(Sequence, SEQUENCE), (StationConfig, STATION_BOUNDS)]
)
def test_every_bound_belongs_to_a_number_of_the_file(
    kind: type[BaseModel], bounds: dict[str, tuple[float, float, str]]
) -> None:
    assert set(bounds) <= number_keys(kind)
    assert all(least < most for least, most, _ in bounds.values())


def test_a_number_out_of_bounds_is_told_with_its_place_and_the_reason() -> None:
    data = replaced(STATION.model_dump(), ("inputs", 1, "load_ohm"), 1e308)
    with pytest.raises(InputError) as caught:
        accept(StationConfig, data)
    expected = "station 'f4t': inputs.1.load_ohm: 1e+308, expected 0.01…1e+07: "
    assert str(caught.value).startswith(expected)


def test_dry_run_text_says_what_matters() -> None:
    text = "\n".join(plan_lines(make_plan(parse_sequence(SHORT), STATION), lambda _: ["foreseen"]))
    for word in ("30 min", "112", "QA-001, QA-002", "repeat the segment", "foreseen", "+2.00"):
        assert word in text
