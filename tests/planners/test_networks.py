"""The forward pass in NumPy; PyTorch's is the oracle in the tests of the modules."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from moe_policy.planners.networks import ARGMAX, Argmax, MixtureOfExperts, SingleNetwork, Softmax

SOURCE = np.random.default_rng(0)


def network(*sizes: int) -> SingleNetwork:
    layers = tuple(itertools.pairwise(sizes))
    return SingleNetwork(
        tuple(SOURCE.normal(size=(outputs, inputs)) for inputs, outputs in layers),
        tuple(SOURCE.normal(size=outputs) for _, outputs in layers),
    )


#: Experts of different widths on purpose.
MIXTURE = MixtureOfExperts(network(2, 4, 3), tuple(network(2, 5 + i, 7) for i in range(3)))
X = SOURCE.normal(size=(50, 2)).astype(np.float32)


def test_the_forward_pass_is_its_formula():
    single = network(2, 5, 3, 4)
    h = X.astype(np.float64)
    for i, (weight, bias) in enumerate(zip(single.weights, single.biases)):
        h = h @ weight.T + bias
        h = np.where(h > 0, h, 0.2 * h) if i < 2 else h
    assert single(X).dtype == np.float32
    np.testing.assert_allclose(single(X), h, rtol=1e-4, atol=1e-5)


def test_inputs_are_not_changed():
    before = X.copy()
    for call in (network(2, 3, 4), network(2, 4), lambda x: MIXTURE(x, ARGMAX)):
        call(X)
        np.testing.assert_array_equal(X, before)


@pytest.mark.parametrize("mixing", [ARGMAX, Softmax(1.0), Softmax(0.1)])
def test_a_mixture_of_one_expert_is_that_network(mixing):
    single = network(2, 6, 7)
    one = MixtureOfExperts(network(2, 4, 1), (single,))
    np.testing.assert_allclose(one(X, mixing), single(X), rtol=1e-6)


def test_argmax_takes_the_row_of_the_chosen_expert():
    choice = MIXTURE.gate(X).argmax(axis=1)
    assert len(np.unique(choice)) > 1
    wanted = MIXTURE.all_experts(X)[choice, np.arange(len(X))]
    np.testing.assert_allclose(MIXTURE(X, ARGMAX), wanted, rtol=1e-4, atol=1e-5)


def test_softmax_weights_all_experts():
    logits = MIXTURE.gate(X).astype(np.float64) / 0.7
    weights = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    wanted = np.einsum("bk,kbr->br", weights, MIXTURE.all_experts(X))
    np.testing.assert_allclose(MIXTURE(X, Softmax(0.7)), wanted, rtol=1e-4, atol=1e-5)


def test_softmax_tends_to_argmax():
    logits = np.sort(MIXTURE.gate(X), axis=1)
    clear = (logits[:, -1] - logits[:, -2]) > 1e-2
    np.testing.assert_allclose(MIXTURE(X, Softmax(1e-4))[clear], MIXTURE(X, ARGMAX)[clear], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("mixing", [ARGMAX, Softmax(0.5)])
def test_rows_do_not_depend_on_their_batch(mixing):
    single = np.concatenate([MIXTURE(row[None], mixing) for row in X])
    np.testing.assert_allclose(single, MIXTURE(X, mixing), rtol=1e-4, atol=1e-5)
    assert MIXTURE(X[:0], mixing).shape == (0, 7)


def test_results_do_not_depend_on_where_arrays_lie_in_memory():
    buffer = np.empty(X.size + 8, np.float32)
    for offset in range(8):
        moved = buffer[offset : offset + X.size].reshape(X.shape)
        moved[:] = X
        np.testing.assert_array_equal(MIXTURE(moved, ARGMAX), MIXTURE(X, ARGMAX))


def test_tensors_are_the_network():
    tensors = MIXTURE.tensors("network.")
    again = SingleNetwork.read(tensors, MIXTURE.experts[1].sizes, "network.experts.1.")
    np.testing.assert_array_equal(again(X), MIXTURE.experts[1](X))
    assert sum(values.size for values in tensors.values()) == MIXTURE.count
    with pytest.raises(ValueError, match=r"expected layers of sizes \(2, 5, 7\), got \(2, 6, 7\)"):
        SingleNetwork.read(tensors, (2, 5, 7), "network.experts.1.")


@pytest.mark.parametrize(
    ("weights", "biases", "error"),
    [
        ((), (), "at least one layer"),
        ((np.zeros(3),), (np.zeros(3),), r"expected weights \(outputs, inputs\)"),
        ((np.zeros((3, 2)),), (np.zeros(2),), "do not fit together"),
        ((np.zeros((3, 2)), np.zeros((4, 2))), (np.zeros(3), np.zeros(4)), "do not fit together"),
    ],
)
def test_layers_that_are_no_network_are_refused(weights, biases, error):
    with pytest.raises(ValueError, match=error):
        SingleNetwork(weights, biases)


def test_misfits_are_refused():
    with pytest.raises(ValueError, match="as many experts"):
        MixtureOfExperts(network(2, 3), (network(2, 7),))
    with pytest.raises(ValueError, match="share their inputs"):
        MixtureOfExperts(network(2, 2), (network(2, 7), network(2, 8)))
    with pytest.raises(TypeError, match="gate and experts: expected SingleNetwork"):
        MixtureOfExperts(network(2, 1), ("expert",))
    for epsilon in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="Argmax"):
            Softmax(epsilon)


@pytest.mark.parametrize("mixing", ["softmax", 0.1, None, Softmax, Argmax])
def test_what_is_no_mixing_is_refused(mixing):
    with pytest.raises(TypeError, match=r"expected Argmax\(\) or Softmax\(epsilon\) .* as mixing, got"):
        MIXTURE(X, mixing)
