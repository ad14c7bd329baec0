from __future__ import annotations

import numpy as np
import pytest
import torch

from moe_policy.learning.architectures import PAPER_SIZES, Architecture, Experts, architecture_of, layer_sizes
from moe_policy.planners.networks import ARGMAX, Argmax, MixtureOfExperts, SingleNetwork, Softmax, count_parameters
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def mixture(k: int = 3, seed: int = 0) -> MixtureOfExperts:
    source = generator(seed)
    experts = [SingleNetwork((2, 5 + i, 7), source) for i in range(k)]  # of different widths on purpose
    return MixtureOfExperts(SingleNetwork((2, 4, k), source), experts)


def points(count: int = 50) -> torch.Tensor:
    return torch.randn(count, 2, generator=generator(1))


def test_forward_agrees_with_numpy():
    network, x = SingleNetwork((2, 5, 3, 4), generator()), points()
    h = x.numpy().astype(np.float64)
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases)):
        h = h @ weight.detach().numpy().T + bias.detach().numpy()
        h = np.where(h > 0, h, 0.2 * h) if i < 2 else h
    np.testing.assert_allclose(network(x).detach().numpy(), h, atol=1e-6)


def test_weights_come_from_the_generator_alone():
    torch.manual_seed(0)
    state = torch.get_rng_state()
    first = SingleNetwork((2, 30, 7), generator(4))
    assert torch.equal(torch.get_rng_state(), state)
    torch.manual_seed(1)
    again = SingleNetwork((2, 30, 7), generator(4))
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), again.parameters()))
    assert float(first.weights[1].detach().abs().max()) <= 1 / 30**0.5


def test_a_mixture_of_one_expert_is_that_network():
    network, x = SingleNetwork((2, 6, 7), generator()), points()
    one = MixtureOfExperts(SingleNetwork((2, 4, 1), generator(1)), [network])
    for mixing in (ARGMAX, Softmax(1.0), Softmax(0.1)):
        torch.testing.assert_close(one(x, mixing), network(x))


def test_argmax_takes_the_row_of_the_chosen_expert():
    network, x = mixture(), points()
    choice = network.gate(x).argmax(dim=1)
    assert len(choice.unique()) > 1
    wanted = network.all_experts(x)[choice, torch.arange(len(x))]
    torch.testing.assert_close(network(x, ARGMAX), wanted)


def test_softmax_weights_all_experts():
    network, x = mixture(), points()
    logits = network.gate(x).detach().double().numpy() / 0.7
    weights = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    wanted = np.einsum("bk,kbr->br", weights, network.all_experts(x).detach().numpy())
    np.testing.assert_allclose(network(x, Softmax(0.7)).detach().numpy(), wanted, atol=1e-5)


def test_softmax_tends_to_argmax():
    network, x = mixture(), points()
    logits = network.gate(x).sort(dim=1).values
    clear = (logits[:, -1] - logits[:, -2]) > 1e-2
    torch.testing.assert_close(network(x, Softmax(1e-4))[clear], network(x, ARGMAX)[clear])


@pytest.mark.parametrize("mixing", [ARGMAX, Softmax(0.5)])
def test_rows_do_not_depend_on_their_batch(mixing):
    network, x = mixture(), points()
    whole = network(x, mixing)
    single = torch.cat([network(row[None], mixing) for row in x])
    torch.testing.assert_close(single, whole)
    assert network(x[:0], mixing).shape == (0, 7)


def test_argmax_gives_the_gate_no_gradient_and_every_chosen_expert_one():
    network, x = mixture(), points()
    network(x, ARGMAX).sum().backward()
    assert all(parameter.grad is None for parameter in network.gate.parameters())
    for i in network.gate(x).argmax(dim=1).unique():
        assert all(parameter.grad is not None for parameter in network.experts[int(i)].parameters())


def test_misfits_are_refused():
    source = generator()
    with pytest.raises(ValueError, match="as many experts"):
        MixtureOfExperts(SingleNetwork((2, 3), source), [SingleNetwork((2, 7), source)])
    with pytest.raises(ValueError, match="share their inputs"):
        MixtureOfExperts(SingleNetwork((2, 2), source), [SingleNetwork((2, 7), source), SingleNetwork((2, 8), source)])
    with pytest.raises(ValueError, match="all positive"):
        SingleNetwork((2, 0, 3), source)
    for epsilon in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="Argmax"):
            Softmax(epsilon)


def test_sizes_of_the_paper():
    assert layer_sizes(PENDULUM, architecture_of(PENDULUM).single) == (2, 300, 75)
    assert layer_sizes(QUADCOPTER_OBSTACLE, architecture_of(QUADCOPTER_OBSTACLE).single) == (7, 1000, 1000, 317)
    assert layer_sizes(QUADCOPTER, architecture_of(QUADCOPTER).gate, 4) == (3, 50, 4)
    # The vehicle's two large clusters get 500 units, with k-means 300.
    vehicle = PAPER_SIZES["GroundVehicle-v0"]
    assert [vehicle.expert(size, 20001, "custom") for size in (45626, 7266)] == [(500,), (200,)]
    assert [vehicle.expert(size, 20001, "kmeans") for size in (28913, 7228)] == [(300,), (200,)]
    assert count_parameters(SingleNetwork((2, 300, 75))) == 3 * 300 + 301 * 75


def test_empty_layers_are_refused():
    with pytest.raises(ValueError, match="units of a hidden layer: expected a whole number of at least 1, got 0"):
        Architecture((10,), (0,), Experts((10,), (10,)))
    with pytest.raises(TypeError, match="hidden layers: expected Sequence, got int 10; write"):
        Architecture(10, (10,), Experts((10,), (10,)))
    with pytest.raises(TypeError, match="units of a hidden layer"):
        Architecture((2.5,), (10,), Experts((10,), (10,)))


@pytest.mark.parametrize("mixing", ["softmax", 0.1, None, Softmax, Argmax])
def test_what_is_no_mixing_is_refused(mixing):
    with pytest.raises(TypeError, match=r"expected Argmax\(\) or Softmax\(epsilon\) .* as mixing, got"):
        mixture()(points(), mixing)


def test_all_experts_give_what_the_chosen_one_gives():
    network, x = mixture(), points()
    for mixing in (ARGMAX, Softmax(0.5)):
        torch.testing.assert_close(network.from_all_experts(x, mixing), network(x, mixing))
