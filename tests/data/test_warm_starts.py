import dataclasses

import numpy as np

from ocp_envs.data.generation import generate
from ocp_envs.data.warm_starts import local_fit
from ocp_envs.sets.sampling import sample
from tests.data.running import COUNT, SMALL, InProcess
from tests.small_problems import DOUBLE_INTEGRATOR


def test_a_local_fit_repeats_a_linear_function_and_weighs_the_near_ones_more():
    rng = np.random.default_rng(0)
    offsets = rng.normal(size=(5, 12, 3)) * 0.1
    order = np.argsort(np.linalg.norm(offsets, axis=2), axis=1)
    offsets = np.take_along_axis(offsets, order[:, :, None], axis=1)
    distance = np.linalg.norm(offsets, axis=2)
    slope, constant = rng.normal(size=(3, 4)), rng.normal(size=(5, 1, 4))
    values = (constant + offsets @ slope).astype(np.float32)
    np.testing.assert_allclose(local_fit(offsets, distance, values), constant[:, 0], atol=2e-3)
    spoilt = values.copy()
    spoilt[:, -1] += 1.0  # the farthest has next to no weight
    np.testing.assert_allclose(local_fit(offsets, distance, spoilt), constant[:, 0], atol=5e-3)
    # All neighbours in one place: their mean.
    np.testing.assert_allclose(local_fit(np.zeros_like(offsets), 0 * distance, values), values.mean(1), atol=1e-5)


def test_fitted_warm_starts_are_one_a_mode_nearer_than_the_neighbours_and_solve_the_same(tmp_path, unguarded):
    p, found = sample(DOUBLE_INTEGRATOR, 7, COUNT), {}
    for fit in (0, 8):
        executor, settings = InProcess(), dataclasses.replace(SMALL, neighbours=1, fit=fit)
        database = generate(DOUBLE_INTEGRATOR, tmp_path / f"{fit}", p, executor=executor, settings=settings)
        task = executor.tasks[-1]
        solved = database.stored(database.stored_rows(task.number))
        distance = np.abs(task.z[:, None] - solved.z[task.owner]).mean(axis=2).min(axis=1, initial=np.inf)
        found[fit] = database.costs().min(axis=1), np.nanmedian(np.where(np.isfinite(distance), distance, np.nan))
        assert database.settings.get("fit", 0) == fit
    np.testing.assert_allclose(found[8][0], found[0][0], rtol=1e-3)
    assert found[8][1] < 0.7 * found[0][1]


def test_where_solutions_are_too_few_for_a_fit_the_nearest_are_taken_as_they_are(tmp_path, unguarded):
    """A linear function of two parameters takes three."""
    p, digests = sample(DOUBLE_INTEGRATOR, 7, 40), set()
    for fit in (0, 2):
        settings = dataclasses.replace(SMALL, fit=fit)
        digests.add(
            generate(DOUBLE_INTEGRATOR, tmp_path / f"{fit}", p, executor=InProcess(), settings=settings).digest()
        )
    assert len(digests) == 1
