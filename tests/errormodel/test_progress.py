import pytest

from errormodel.progress import listening, stage, track


def test_a_loop_is_the_same_when_nobody_listens():
    assert list(track("abc")) == ["a", "b", "c"]
    assert list(track(())) == []


def test_loops_within_a_loop_are_parts_of_its_step():
    told: list[float] = []
    with listening(told.append):
        for _ in track((1, 2)):
            with stage(0.5, 1.0):
                list(track("ab"))
    assert told == pytest.approx([0, 0.25, 0.25, 0.375, 0.5, 0.5, 0.5, 0.75, 0.75, 0.875, 1, 1, 1])
    assert told == sorted(told)


def test_a_loop_that_is_left_early_gives_its_place_back():
    told: list[float] = []
    with listening(told.append):
        with stage(0.0, 0.5):
            for k in track((1, 0)):
                if not k:
                    break
        list(track((1,)))
    assert told[-3:] == [0.5, 0.0, 1.0]
