import copy
import pickle

import casadi as ca
import numpy as np
import pytest

from ocp_envs.support.batch import BatchFunction, dense_function
from tests.threads import in_threads


@pytest.fixture(scope="module")
def function():
    x, a = ca.SX.sym("x", 3), ca.SX.sym("a", 2, 3)
    return BatchFunction(dense_function("f", [x, a], [ca.mtimes(a, x), ca.jacobian(ca.sin(x), x)]))


@pytest.mark.parametrize("size", [0, 1, 2, 17])
def test_agrees_with_numpy_for_vectors_and_matrices(function, size):
    rng = np.random.default_rng(size)
    x, a = rng.normal(size=(size, 3)), rng.normal(size=(size, 2, 3))
    product, jacobian = function(x, a)
    np.testing.assert_allclose(product, np.einsum("bij,bj->bi", a, x), atol=1e-14)
    assert jacobian.shape == (size, 3, 3)
    for row, point in zip(jacobian, x):
        np.testing.assert_allclose(row, np.diag(np.cos(point)), atol=1e-14)


def test_results_of_one_call_survive_the_next(function):
    x, a = np.ones((1, 3)), np.ones((1, 2, 3))
    first, _ = function(x, a)
    function(5 * x, a)
    np.testing.assert_allclose(first, 3.0)


def test_accepts_arrays_that_are_not_contiguous(function):
    x = np.arange(12.0).reshape(3, 4).T[:, :3]
    a = np.ones((4, 2, 3))
    np.testing.assert_allclose(function(x, a)[0], x.sum(axis=1, keepdims=True).repeat(2, axis=1))


def test_wrong_shapes_and_sparse_outputs_are_refused(function):
    with pytest.raises(ValueError, match=r"argument 0 has shape \(2, 2\), expected \(2, 3\)"):
        function(np.ones((2, 2)), np.ones((2, 2, 3)))
    with pytest.raises(TypeError, match="takes 2 arguments"):
        function(np.ones((2, 3)))
    x = ca.SX.sym("x", 2)
    with pytest.raises(ValueError, match="dense_function"):
        BatchFunction(ca.Function("sparse", [x], [ca.jacobian(ca.sin(x), x)]))


def test_threads_share_a_function_without_mixing_their_numbers(function):
    def products(thread):
        x, a = np.full((200, 3), float(thread)), np.ones((200, 2, 3))
        return all((function(x, a)[0] == 3.0 * thread).all() for _ in range(200))

    assert all(in_threads(products, 8))


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_a_copy_evaluates_the_same_function(function, duplicate):
    x, a = np.ones((2, 3)), np.ones((2, 2, 3))
    np.testing.assert_array_equal(duplicate(function)(x, a)[1], function(x, a)[1])
