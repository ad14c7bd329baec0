from dataclasses import replace

import numpy as np
import pytest

from moe_policy.learning.clustering import cluster
from moe_policy.learning.reactions import reactions
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE, contact
from tests.synthetic import fake_samples, flights

PROBLEM = QUADCOPTER_OBSTACLE


@pytest.mark.parametrize("active", [True, False])
def test_a_sphere_pushes_away_from_its_centre(active):
    samples = flights(active=active)
    found = reactions(samples)
    outwards = contact(PROBLEM, samples.parameters, samples.trajectory, samples.multipliers)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    np.testing.assert_allclose(found[:, :3], outwards, atol=1e-6)
    assert not found[:, 3:].any()


def test_sides_are_clusters_of_directions():
    samples = flights(200)
    labels = cluster(samples, "reaction", k=4)
    assert (labels.method, labels.k, labels.names[0]) == ("reaction", 4, "side 0")
    directions = reactions(samples)
    centres = np.stack([directions[labels.values == i].mean(axis=0) for i in range(4)])
    nearest = np.linalg.norm(directions[:, None] - centres, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(nearest, labels.values)


def test_without_path_constraints_or_multipliers_there_are_no_sides():
    with pytest.raises(ValueError, match="PendulumSwingup-v0 has no path constraints"):
        reactions(fake_samples())
    unknown = replace(flights(), multipliers=np.full((40, PROBLEM.knots, 1), np.nan))
    with pytest.raises(ValueError, match="the multipliers of some samples are not known"):
        cluster(unknown, "reaction", k=2)
