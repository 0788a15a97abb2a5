from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.errors import InputError
from thermo.planning.legs import commanded_c, expand, lagged_c, leg_at
from thermo.planning.sequence import (
    Hold,
    Ramp,
    Sequence,
    TemperatureCycle,
    TemperatureProgramme,
    load_sequence,
    parse_sequence,
    sequence_toml,
)

ROOT = Path(__file__).parents[3]
SHORT = (ROOT / "examples/sequences/short.toml").read_text(encoding="utf-8")

temps = st.floats(-50, 80).map(lambda t: round(t, 2))
rates = st.floats(0.05, 5).map(lambda r: round(r, 3))
holds = st.builds(
    Hold,
    kind=st.just("hold"),
    duration_min=st.floats(0.1, 100),
    temp_c=st.none() | temps,
)
ramps = st.builds(Ramp, kind=st.just("ramp"), to_c=temps, rate_c_per_min=rates)
cycles = st.builds(
    TemperatureCycle,
    kind=st.just("cycle"),
    low_c=st.floats(-50, 10).map(lambda t: round(t, 2)),
    high_c=st.floats(10.5, 80),
    rate_c_per_min=rates,
    soak_min=st.sampled_from([0.0, 20.0]),
    count=st.integers(1, 4),
)


@st.composite
def programmes(draw: st.DrawFn) -> TemperatureProgramme:
    start_c = draw(temps)
    segments: list[Hold | Ramp | TemperatureCycle] = []
    here_c = start_c
    for segment in draw(st.lists(holds | ramps | cycles, min_size=1, max_size=5)):
        if isinstance(segment, Ramp):
            if segment.to_c == here_c:
                continue
            here_c = segment.to_c
        elif isinstance(segment, TemperatureCycle):
            here_c = segment.low_c
        elif segment.temp_c is not None:
            here_c = segment.temp_c
        segments.append(segment)
    segments = segments or [Hold(kind="hold", duration_min=1.0)]
    return TemperatureProgramme(start_c=start_c, segments=tuple(segments))


@given(programmes())
def test_legs_join_without_gaps_and_keep_their_rates(programme: TemperatureProgramme) -> None:
    legs = expand(programme)
    assert legs[0].start_s == 0
    for before, after in pairwise(legs):
        assert after.start_s == before.end_s
        assert after.start_c - after.step_c == pytest.approx(before.end_c, abs=1e-12)
    asked = {s.rate_c_per_min for s in programme.segments if not isinstance(s, Hold)}
    for leg in legs:
        assert leg.end_s > leg.start_s
        if leg.is_ramp:
            assert leg.step_c == 0
            assert min(abs(abs(leg.rate_c_per_min) - r) for r in asked) < 1e-9


@given(programmes(), st.floats(0, 1))
def test_commanded_temperature_is_within_its_leg(
    programme: TemperatureProgramme, at: float
) -> None:
    legs = expand(programme)
    time_s = at * legs[-1].end_s
    leg = legs[int(leg_at(legs, time_s))]
    low, high = sorted((leg.start_c, leg.end_c))
    assert low - 1e-9 <= float(commanded_c(legs, time_s)) <= high + 1e-9


@given(programmes(), st.floats(10, 1000))
def test_lagged_temperature_obeys_its_differential_equation(
    programme: TemperatureProgramme, lag_s: float
) -> None:
    legs = expand(programme)
    # away from the legs' ends a central difference must equal (commanded - lagged) / lag
    for leg in legs:
        mid_s, h_s = (leg.start_s + leg.end_s) / 2, min(1.0, (leg.end_s - leg.start_s) / 10)
        before, here, after = lagged_c(legs, [mid_s - h_s, mid_s, mid_s + h_s], lag_s)
        slope = (after - before) / (2 * h_s)
        expected = (float(commanded_c(legs, mid_s)) - here) / lag_s
        # h²/6 of the third derivative (≤ 150 °C / lag³) is below 3 % of 150/lag
        assert slope == pytest.approx(expected, abs=0.03 * 150 / lag_s + 1e-9)


def test_lag_of_a_long_ramp_is_rate_times_lag() -> None:
    programme = TemperatureProgramme(
        start_c=-40, segments=(Ramp(kind="ramp", to_c=70, rate_c_per_min=1.0),)
    )
    legs = expand(programme)
    behind = commanded_c(legs, 6000.0) - lagged_c(legs, 6000.0, 300.0)
    assert float(behind) == pytest.approx(5.0, abs=1e-6)  # 1 °C/min × 5 min; exp(-20) is left


def test_cycle_is_spelt_out() -> None:
    programme = TemperatureProgramme(
        start_c=20,
        segments=(
            TemperatureCycle(
                kind="cycle", low_c=-40, high_c=70, rate_c_per_min=2, soak_min=30, count=2
            ),
        ),
    )
    legs = expand(programme)
    assert [leg.end_c for leg in legs] == [-40, -40, 70, 70, -40, -40, 70, 70, -40, -40]
    assert [leg.is_ramp for leg in legs] == [True, False] * 5
    assert legs[-1].end_s == 60 * (30 + 4 * 55 + 5 * 30)


@pytest.mark.parametrize("path", sorted((ROOT / "examples/sequences").glob("*.toml")), ids=str)
def test_shipped_sequences_survive_being_stored(path: Path) -> None:
    sequence = load_sequence(path)
    assert parse_sequence(sequence_toml(sequence)) == sequence


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20), programmes())
def test_written_toml_reads_back_equal(name: str, programme: TemperatureProgramme) -> None:
    base = parse_sequence(SHORT)
    sequence = base.model_copy(update={"name": name, "temperature": programme})
    assert parse_sequence(sequence_toml(sequence)) == sequence


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('name = "short"', 'name = "short"\ncolour = "red"', "colour"),
        ("period_s = 15.0", "period_s = 0.0", "sampling.period_s"),
        ("period_s = 15.0", "period_s = inf", "sampling.period_s"),
        ("period_s = 15.0", 'period_s = "15"', "sampling.period_s"),
        ("rate_c_per_min = 2.0", "rate_c_per_min = -2.0", "temperature.segments.1"),
        ("rate_c_per_min = 2.0", "rate_c_per_min = 0", "temperature.segments.1"),
        ("to_c = 26.0", "to_c = 20.0", "temperature.segments.1"),
        ("to_c = 26.0", "to_c = nan", "temperature.segments.1"),
        ("duration_min = 2.0", "duration_min = 1e300", "temperature.segments.0"),
        ('kind = "ramp"', 'kind = "jump"', "temperature.segments.1"),
        ("QA-002", "QA-001", "twice"),
        ("angles_deg = [0.0, 90.0, 180.0, 270.0]", "angles_deg = []", "positions.angles_deg"),
        ("[0.0, 90.0, 180.0, 270.0]", "[0.0, 0.0]", "twice"),
        ("[after_gap]", "[limits]\nchamber_c = [0.0, 25.0]\n[after_gap]", "temperature.segments.1"),
        ('gap_rule = "resoak"', 'gap_rule = "hope"', "after_gap.gap_rule"),
        *(
            ("[after_gap]", f"[limits]\n{key} = {value}\n[after_gap]", f"limits.{key}")
            for key, value in (
                ("chamber_c", "[-55.0, 1e6]"),
                ("max_bad_share", "1.0"),
                ("on_thermistor_lost", '"hope"'),
            )
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, place: str) -> None:
    assert old in SHORT
    path = tmp_path / "wrong.toml"
    path.write_text(SHORT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_sequence(path)
    message = str(caught.value)
    assert str(path) in message
    assert place in message
    assert "\n" not in message


def test_a_sequence_is_immutable() -> None:
    sequence: Sequence = parse_sequence(SHORT)
    with pytest.raises(ValueError, match="frozen"):
        sequence.name = "other"  # pyright: ignore[reportAttributeAccessIssue]
    assert np.isclose(sequence.sampling.period_s, 15.0)


def test_a_programme_of_a_thousand_segments_survives_being_stored() -> None:
    base = parse_sequence(SHORT)
    segments = (TemperatureCycle(kind="cycle", low_c=-40, high_c=70, rate_c_per_min=2),) * 1000
    programme = base.temperature.model_copy(update={"segments": segments})
    sequence = base.model_copy(update={"temperature": programme})
    assert parse_sequence(sequence_toml(sequence)) == sequence
