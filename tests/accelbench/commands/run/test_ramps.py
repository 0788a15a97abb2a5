from dataclasses import replace

from accelbench.commands.run.ramps import ramp_lines
from thermo.station.checks.uniformity import RampVerdict

GOOD = RampVerdict(
    serial="QA-001", run=1, segment=1, commanded=2.0, measured=2.006, measured_sigma=0.001,
    share_inside=1.0, half_band=0.1, readings=190, longest_outside_min=0.0, unread_min=0.0,
    noise_c=0.01, slope_gain=1.0, passed=True, sins_rate=0.9, mismatch_percent=122.2,
    sentence="QA-001, run 1, segment 1: uniform",
)  # fmt: skip


def test_ramps_that_are_uniform_are_one_line_and_the_mismatch_is_explained():
    total, mismatch = ramp_lines([GOOD] * 24, verbose=False)
    assert total == (
        "24 of 24 ramps uniform, the mean rate at worst 0.3 % from the commanded one; -v tells each"
    )
    assert "122 % faster than the self-heating of the SINS, at 0.9 °C/min" in mismatch


def test_a_ramp_that_is_not_uniform_is_told_and_with_v_each_is():
    bad = replace(GOOD, passed=False, sentence="QA-001, run 2, segment 1: NOT uniform")
    short = replace(GOOD, readings=0, passed=False, sentence="QA-001, run 3: too short")
    lines = list(ramp_lines([GOOD, bad, short], verbose=False))
    assert lines[0].startswith("1 of 2 ramps uniform")
    assert "1 ramps had too few readings for a verdict" in lines[0]
    assert [line for line in lines if "segment" in line] == [f"  {bad.sentence}"]
    every = list(ramp_lines([GOOD, bad, short], verbose=True))
    assert [line.strip() for line in every[1:4]] == [v.sentence for v in (GOOD, bad, short)]


def test_no_ramps_are_no_lines():
    assert list(ramp_lines([], verbose=True)) == []
