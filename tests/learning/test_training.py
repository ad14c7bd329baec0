from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from moe_policy.experiments.seeds import Training
from moe_policy.learning.architectures import Architecture, Experts
from moe_policy.learning.checkpoint import Checkpoint, CheckpointError
from moe_policy.learning.clustering import Labels, cluster
from moe_policy.learning.examples import Split
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_mixture, fit_single
from moe_policy.planners.networks import ARGMAX, Softmax
from moe_policy.planners.prediction_error import standardised_error, validation_error
from moe_policy.planners.scaling import Standardizer
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.support.pool import WorkerPool
from tests.synthetic import FakeDatabase, beyond_borders, fake_samples
from tests.trainings import QUICK, equal, weights


def test_the_seed_decides_every_weight_and_nothing_global_is_touched(samples):
    torch.manual_seed(0)
    np.random.seed(0)  # noqa: NPY002
    states = torch.get_rng_state(), np.random.get_state()[1].copy()  # noqa: NPY002
    first = fit_single(samples, settings=QUICK, seed=5)
    assert torch.equal(torch.get_rng_state(), states[0])
    np.testing.assert_array_equal(np.random.get_state()[1], states[1])  # noqa: NPY002
    torch.manual_seed(9)
    assert equal(weights(first), weights(fit_single(FakeDatabase(samples), settings=QUICK, seed=5)))
    assert not equal(weights(first), weights(fit_single(samples, settings=QUICK, seed=6)))


def test_mixtures_are_decided_by_their_seed(samples, pretrained):
    again = fit_mixture(samples, cluster(samples, "custom"), settings=QUICK)
    assert equal(weights(pretrained), weights(again))


def test_the_scalers_see_the_training_split_only(samples):
    planner = fit_single(samples, settings=QUICK, seed=2)
    split = Split.draw(len(samples.parameters), 0.2, 2)
    assert len(split.test) == 80
    assert not set(split.training) & set(split.test)
    for scaler, values in ((planner.inputs, samples.parameters), (planner.outputs, samples.trajectory.flat())):
        wanted = Standardizer.fit(values[split.training])
        np.testing.assert_array_equal(scaler.mean, wanted.mean)
        np.testing.assert_array_equal(scaler.std, wanted.std)


def test_an_executor_trains_the_same_mixture(samples, pretrained):
    with WorkerPool(2) as pool:
        parallel = fit_mixture(samples, cluster(samples, "custom"), settings=QUICK, executor=pool)
    here, there = weights(pretrained), weights(parallel)
    assert list(here) == list(there)
    for key, value in here.items():
        np.testing.assert_allclose(there[key], value, atol=1e-6, err_msg=key)
    assert [part.name for part in parallel.report.parts] == [part.name for part in pretrained.report.parts]
    assert parallel.report.part("gate").accuracy == pretrained.report.part("gate").accuracy


def test_the_report_is_true(samples, pretrained):
    split = Split.draw(len(samples.parameters), 0.2, 0)
    single = fit_single(samples, settings=QUICK)
    for planner in (single, pretrained):
        error = standardised_error(planner, samples.parameters[split.test], samples.trajectory[split.test])
        assert planner.report.test_error == pytest.approx(error, rel=1e-4)
        training_details = dict(planner.details["training"])
        assert training_details.pop("peak_memory_gb") > 0.05
        assert training_details == planner.report.summary()
    part = single.report.part("single")
    assert part.test_loss == pytest.approx(single.report.test_error, rel=1e-5)
    assert part.epochs == 15
    assert part.test_loss == min(part.test_losses) == part.test_losses[part.best_epoch]
    gate = pretrained.report.part("gate")
    choice, _ = pretrained.gate(samples.parameters[split.test])
    assert gate.accuracy == pytest.approx((choice == samples.mode[split.test]).mean())
    with pytest.raises(KeyError, match="'gate', 'expert 0', 'expert 1'"):
        pretrained.report.part("expert 7")


def test_experts_learn_their_own_cluster_alone(samples, pretrained):
    # Other trajectories in cluster 1 must leave expert 0 as it is; scalers are held by keeping the flat rows' multiset.
    swapped = samples.trajectory.flat().copy()
    split = Split.draw(len(swapped), 0.2, 0)
    rows = split.training[samples.mode[split.training] == 1]
    swapped[rows] = swapped[rows[::-1]]
    system = samples.problem.system
    other = dataclasses.replace(
        samples, trajectory=type(samples.trajectory).from_flat(swapped, samples.problem.knots, system.nx, system.nu)
    )
    changed = fit_mixture(other, cluster(other, "custom"), settings=QUICK)
    for i, same in ((0, True), (1, False)):
        a, b = (planner.network.experts[i].tensors() for planner in (pretrained, changed))
        close = all(np.allclose(a[key], b[key], atol=1e-4) for key in a)
        assert close is same


def test_a_mixture_of_one_expert_is_the_single_network(samples):
    everything = Labels(np.zeros(len(samples.parameters), dtype=int), ("all",), "custom")
    sizes = Architecture((20,), (5,), Experts((20,), (20,)))
    mixture = fit_mixture(samples, everything, settings=QUICK, architecture=sizes)
    single = fit_single(samples, settings=QUICK, sizes=(2, 20, 75))
    wanted = single(samples.parameters).flat()
    for mixing in (ARGMAX, Softmax(1.0)):
        np.testing.assert_allclose(
            dataclasses.replace(mixture, mixing=mixing)(samples.parameters).flat(), wanted, atol=1e-5
        )


def test_a_mixture_beats_a_single_network_at_a_discontinuity():
    samples, fresh = fake_samples(count=800), fake_samples(count=500, seed=1)
    settings = TrainingSettings(epochs=120)
    single = fit_single(samples, settings=settings)
    mixture = fit_mixture(samples, cluster(samples, "custom"), settings=settings)
    assert mixture.parameters_total < single.parameters_total
    near = np.abs(fresh.parameters[:, 0] - np.pi) < 0.3
    clear = near & (np.abs(fresh.parameters[:, 0] - np.pi) > 0.05)
    rows = np.flatnonzero(clear)
    p, optimal = fresh.parameters[rows], fresh.trajectory[rows]
    errors = [validation_error(planner, p, optimal) for planner in (single, mixture)]
    assert errors[1] < errors[0] / 4


def test_patience_stops_and_the_best_weights_are_kept(samples):
    settings = dataclasses.replace(TrainingSettings.paper(), learning_rate=0.1, epochs=300)
    part = fit_single(samples, settings=settings).report.part("single")
    assert part.epochs < 300
    assert part.epochs == part.best_epoch + 8 + 1
    assert min(part.test_losses) == part.test_loss


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"settings": {"epochs": 3}}, "settings: expected TrainingSettings, got dict"),
        ({"seed": -1}, "seed: expected a whole number of at least 0, got -1"),
        ({"seed": 1.5}, "seed: expected a whole number"),
        ({"checkpoints": 3}, "checkpoints: expected str or PathLike or None, got int 3"),
    ],
)
def test_wrong_arguments_are_named(samples, arguments, match):
    with pytest.raises((TypeError, ValueError), match=match):
        fit_single(samples, **{"settings": QUICK} | arguments)


def test_labels_are_those_of_a_clustering(samples):
    with pytest.raises(TypeError, match=r"labels: expected Labels, got ndarray "):
        fit_mixture(samples, samples.mode, settings=QUICK)


def test_mistakes_are_named(samples):
    with pytest.raises(ValueError, match=r"needs layer sizes \(2, …, 75\)"):
        fit_single(samples, sizes=(3, 20, 75), settings=QUICK)
    with pytest.raises(ValueError, match="labels of 2 samples"):
        fit_mixture(samples, Labels(np.array([0, 1]), ("a", "b"), "custom"), settings=QUICK)
    lonely = np.zeros(len(samples.parameters), dtype=int)
    lonely[Split.draw(len(lonely), 0.2, 0).test[0]] = 1
    with pytest.raises(ValueError, match="no training sample"):
        fit_mixture(samples, Labels(lonely, ("a", "b"), "custom"), settings=QUICK)
    with pytest.raises(ValueError):
        fit_single(dataclasses.replace(samples, problem=QUADCOPTER), settings=QUICK)


class Stop(Exception):
    """What interrupts a training."""


@pytest.fixture
def interrupted(monkeypatch):
    """Training states are written after every epoch; the training stops when so many have been written in all."""
    write, written = Checkpoint.write, []
    monkeypatch.setattr(Checkpoint, "due", True)

    def after(count):
        def write_and_stop(self, state):
            write(self, state)
            written.append(state)
            if len(written) == count:
                raise Stop

        written.clear()
        monkeypatch.setattr(Checkpoint, "write", write_and_stop)
        return written

    return after


@pytest.mark.parametrize("after", [4, 20, 44])
def test_an_interrupted_training_goes_on_and_ends_with_the_same_weights(
    samples, pretrained, tmp_path, interrupted, after
):
    def train():
        return fit_mixture(samples, cluster(samples, "custom"), settings=QUICK, checkpoints=tmp_path)

    interrupted(after)
    with pytest.raises(Stop):
        train()
    written = interrupted(-1)
    again = train()
    assert len(written) == 15 * len(pretrained.report.parts) - after  # what was done is not done again
    assert equal(weights(pretrained), weights(again))
    for part, wanted in zip(again.report.parts, pretrained.report.parts, strict=True):
        assert (part.training_losses, part.test_losses) == (wanted.training_losses, wanted.test_losses)


def test_a_training_that_ran_out_of_patience_stays_finished(samples, tmp_path, interrupted):
    hasty = TrainingSettings(epochs=200, patience=1, learning_rate=0.05, final_fraction=1.0)
    first = fit_single(samples, settings=hasty, checkpoints=tmp_path)
    assert first.report.parts[0].epochs < 200
    written = interrupted(-1)
    again = fit_single(samples, settings=hasty, checkpoints=tmp_path)
    assert not written
    assert equal(weights(first), weights(again))
    assert first.report.parts == again.report.parts


def test_checkpoints_of_another_training_are_refused(samples, tmp_path):
    fit_single(samples, settings=QUICK, checkpoints=tmp_path)
    for other in ({"seed": 1}, {"settings": TrainingSettings(epochs=16)}):
        with pytest.raises(CheckpointError, match="other data, settings or seed"):
            fit_single(samples, **({"settings": QUICK, "checkpoints": tmp_path} | other))


def test_a_loss_that_explodes_is_an_error(samples):
    with pytest.raises(FloatingPointError, match="lower learning_rate"):
        fit_single(samples, settings=TrainingSettings(epochs=200, learning_rate=1e30))


def test_experts_that_begin_together_know_what_all_samples_share(samples):
    labels, few = cluster(samples, "custom"), TrainingSettings(epochs=2, learning_rate=1e-9)
    planner = fit_mixture(samples, labels, settings=few, together=0.5)
    single = fit_single(samples, settings=dataclasses.replace(few, epochs=1), sizes=(2, 20, planner.outputs.mean.size))
    for expert in planner.expert_planners():
        # with so low a rate, experts hardly move from where they begin
        np.testing.assert_allclose(expert(samples.parameters).flat(), single(samples.parameters).flat(), atol=1e-3)
    assert [part.name for part in planner.report.parts] == ["gate", "expert 0", "expert 1", "shared 0"]
    assert [part.epochs for part in planner.report.parts] == [2, 1, 1, 1]
    assert planner.details["clusters"]["together"] == 0.5
    assert len(Training.of(planner).part_test_errors) == 2


@pytest.mark.parametrize("together", [1.0, 0.01, -0.5])
def test_experts_cannot_be_together_for_all_epochs_or_none(samples, together):
    with pytest.raises(ValueError, match="together"):
        fit_mixture(samples, cluster(samples, "custom"), settings=QUICK, together=together)


def test_experts_learn_their_family_beyond_its_border_and_the_gate_does_not(samples):
    labels = cluster(samples, "custom")
    found = beyond_borders(samples, labels.values, np.arange(0, len(samples), 7))
    usual, further = (fit_mixture(samples, labels, settings=QUICK, beyond=each) for each in (None, found))
    changed = {key: not np.array_equal(value, weights(further)[key]) for key, value in weights(usual).items()}
    assert {key for key, value in changed.items() if not value} == {key for key in changed if "gate" in key}
    assert further.details["clusters"]["beyond"] == np.bincount(found.family, minlength=labels.k).tolist()


def test_trajectories_beyond_the_borders_of_other_families_are_refused(samples):
    labels = cluster(samples, "custom")
    found = beyond_borders(samples, labels.values, np.array([0]))
    with pytest.raises(ValueError, match="beyond: expected trajectories of"):
        fit_mixture(samples, labels, settings=QUICK, beyond=dataclasses.replace(found, cost=found.cost[1:]))


def test_no_expert_learns_strays_and_the_gate_learns_what_is_known_there(samples):
    labels = cluster(samples, "custom")
    strays = np.arange(len(samples)) % 9 == 0
    found = beyond_borders(samples, labels.values, np.flatnonzero(strays))
    known = dataclasses.replace(
        found, cost=np.where(found.cost > 1, found.cost, np.where(strays[:, None], np.inf, 1.0))
    )
    with_strays = dataclasses.replace(labels, strays=strays)
    mixture = fit_mixture(samples, with_strays, settings=QUICK, beyond=known)
    parts = {part.name: part.training_samples + part.test_samples for part in mixture.report.parts}
    assert parts["gate"] == len(samples)
    assert sum(parts[f"expert {i}"] for i in range(labels.k)) == len(samples)  # one trajectory beyond for each stray
    changed = np.where(strays, (labels.values + 1) % labels.k, labels.values)
    other = fit_mixture(samples, dataclasses.replace(labels, values=changed), settings=QUICK)
    gates = [{key: value for key, value in weights(each).items() if "gate" in key} for each in (mixture, other)]
    assert equal(*gates)
    assert mixture.details["clusters"]["strays"] == strays.sum()
