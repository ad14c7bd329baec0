from __future__ import annotations

import numpy as np
import pytest
import torch

from moe_policy.planners import networks
from moe_policy.planners.modules import MixtureModule, SingleModule, module_of, outputs_of
from moe_policy.planners.networks import ARGMAX, Argmax, Softmax


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def mixture(k: int = 3, seed: int = 0) -> MixtureModule:
    source = generator(seed)
    experts = [SingleModule((2, 5 + i, 7), source) for i in range(k)]  # of different widths on purpose
    return MixtureModule(SingleModule((2, 4, k), source), experts)


@pytest.mark.parametrize("mixing", [ARGMAX, Softmax(0.5)])
def test_a_network_and_its_module_calculate_the_same(mixing):
    module, x = mixture(), points()
    for one in (module, module.gate):
        network = one.network()
        for again in (one, module_of(network)):
            wanted = outputs_of(again, x, mixing).detach().numpy()
            np.testing.assert_allclose(networks.outputs_of(network, x.numpy(), mixing), wanted, atol=1e-6)


def test_the_weights_of_a_module_are_copies_that_can_be_trained():
    network = mixture().network()
    before = {name: values.copy() for name, values in network.tensors().items()}
    with torch.inference_mode():
        module = module_of(network)
    module(points(), Softmax(0.5)).sum().backward()
    with torch.no_grad():
        for parameter in module.parameters():
            parameter -= parameter.grad
    for name, values in network.tensors().items():
        np.testing.assert_array_equal(values, before[name])


def points(count: int = 50) -> torch.Tensor:
    return torch.randn(count, 2, generator=generator(1))


def test_weights_come_from_the_generator_alone():
    torch.manual_seed(0)
    state = torch.get_rng_state()
    first = SingleModule((2, 30, 7), generator(4))
    assert torch.equal(torch.get_rng_state(), state)
    torch.manual_seed(1)
    again = SingleModule((2, 30, 7), generator(4))
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), again.parameters()))
    assert float(first.weights[1].detach().abs().max()) <= 1 / 30**0.5


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
        MixtureModule(SingleModule((2, 3), source), [SingleModule((2, 7), source)])
    with pytest.raises(ValueError, match="share their inputs"):
        MixtureModule(SingleModule((2, 2), source), [SingleModule((2, 7), source), SingleModule((2, 8), source)])
    with pytest.raises(ValueError, match="all positive"):
        SingleModule((2, 0, 3), source)
    for epsilon in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="Argmax"):
            Softmax(epsilon)


@pytest.mark.parametrize("mixing", ["softmax", 0.1, None, Softmax, Argmax])
def test_what_is_no_mixing_is_refused(mixing):
    with pytest.raises(TypeError, match=r"expected Argmax\(\) or Softmax\(epsilon\) .* as mixing, got"):
        mixture()(points(), mixing)


def test_all_experts_give_what_the_chosen_one_gives():
    network, x = mixture(), points()
    for mixing in (ARGMAX, Softmax(0.5)):
        torch.testing.assert_close(network.from_all_experts(x, mixing), network(x, mixing))
