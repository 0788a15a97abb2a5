"""An accelerometer mounted turned on the head: its own errors go with it, the head's stay."""

import numpy as np
import pytest

from errormodel.discrepancy.search.choices import Choice
from errormodel.noise.model import NoiseModel, given_noise
from tests.thermo.discrepancy.examples import carried_out, hidden_runs
from thermo.discrepancy.baseline import bare_baseline
from thermo.discrepancy.experiment import Experiment, propose_separation
from thermo.discrepancy.find import find_discrepancy
from thermo.discrepancy.problem.source import ThermalSource
from thermo.recording.channel import channel_of
from thermo.recording.files import join_runs
from thermo.selection.orders import mounted

WHITE = given_noise(NoiseModel(white=5.0 / 6**0.5))


def proposed(runs: object, name: str, rivals: list[str]) -> Experiment:
    channel = channel_of(runs, "A")  # type: ignore[arg-type]
    source = ThermalSource(channel, bare_baseline(channel))
    return propose_separation(source, WHITE, Choice(name, ()), rivals)


@pytest.mark.parametrize("hidden", [{"k3": 20.0}, {"head": 40.0}])
def test_a_turned_mounting_tells_third_order_from_the_heads_harmonic(hidden) -> None:
    runs = hidden_runs(3, hidden, rates=(2.0, 2.0), every_45=True)
    made = proposed(runs, "third_order", ["indexer_harmonic"])
    assert made.d_before is not None
    assert made.d_before < 0.1  # −2 sin θ cos² θ is sin 2θ · cos θ at any angle
    assert made.d_after is not None
    assert made.d_after > 10.0
    assert made.sequence is not None
    assert made.sequence.accelerometers[0].mount_deg in (45.0, 90.0)
    more = carried_out(3, made.sequence, hidden)
    channel = channel_of(join_runs([runs, more]), "A")
    source = ThermalSource(channel, mounted(bare_baseline(channel), channel))
    chi2 = {
        name: float(np.sum(source.fitted([Choice(name, ())], NoiseModel()).residual ** 2))
        for name in ("third_order", "indexer_harmonic")
    }
    right = "third_order" if "k3" in hidden else "indexer_harmonic"
    wrong = next(n for n in chi2 if n != right)
    # an alias set ends at 9 in twice the log-likelihood, a block mean has 5/√6 µg
    assert chi2[wrong] - chi2[right] > 9.0 * 25.0 / 6.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(11, 15))
def test_what_four_positions_cannot_show_is_named_after_the_experiment_proposed(seed: int) -> None:
    runs = hidden_runs(seed, {"k3": 20.0}, rates=(2.0, 2.0))
    (before,) = find_discrepancy(runs, model="bare")
    assert (before.verdict, "third_order" in before.invisible) == ("nothing", True)
    assert before.experiment is not None
    assert before.experiment.sequence is not None
    more = carried_out(seed, before.experiment.sequence, {"k3": 20.0})
    (after,) = find_discrepancy(join_runs([runs, more]), model="bare")
    assert [(after.verdict, e.name) for e in after.effects] == [("named", "third_order")]
    # a run's mounting is known from the other runs of it: forgotten, it would leave 70 µg
    assert after.heldout is not None
    assert after.heldout.after_ug < 1.5 * after.floor_ug


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 7))
@pytest.mark.parametrize(
    ("hidden", "name"), [({"k3": 20.0}, "third_order"), ({"head": 40.0}, "indexer_harmonic")]
)
def test_an_alias_set_becomes_a_name_after_the_experiment_proposed(seed, hidden, name) -> None:
    runs = hidden_runs(seed, hidden, rates=(2.0, 2.0), every_45=True)
    (before,) = find_discrepancy(runs, model="bare")
    assert {"third_order", "indexer_harmonic"} <= set(*before.alias_sets)
    assert before.experiment is not None
    assert before.experiment.sequence is not None
    more = carried_out(seed, before.experiment.sequence, hidden)
    (after,) = find_discrepancy(join_runs([runs, more]), model="bare")
    assert [(after.verdict, e.name) for e in after.effects] == [("named", name)]


def test_an_experiment_is_proposed_for_runs_of_two_mountings_too() -> None:
    runs = hidden_runs(3, {"k3": 20.0}, rates=(2.0,), every_45=True)
    made = proposed(runs, "third_order", ["indexer_harmonic"])
    assert made.sequence is not None
    channel = channel_of(join_runs([runs, carried_out(3, made.sequence, {"k3": 20.0})]), "A")
    model = mounted(bare_baseline(channel), channel)
    assert mounted(model, channel).names == model.names
    again = propose_separation(
        ThermalSource(channel, model), WHITE, Choice("third_order", ()), ["indexer_harmonic"]
    )
    assert again.d_before is not None
    assert again.d_before > 5.0


def test_a_turned_recording_has_its_forces_and_the_heads_angle() -> None:
    runs = hidden_runs(1, rates=(2.0,))
    made = proposed(runs, "third_order", ["indexer_harmonic"])
    assert made.sequence is not None
    more = carried_out(1, made.sequence)
    record = channel_of(join_runs([runs, more]), "A").record
    turned = made.sequence.accelerometers[0].mount_deg
    late = record["mounting"] == 1.0
    assert set(np.unique(record["mounting"])) == {0.0, 1.0}
    np.testing.assert_allclose(
        record["a_i_g"][late], np.sin(np.deg2rad(record["head_deg"][late] + turned)), atol=1e-14
    )
