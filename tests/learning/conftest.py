import pytest

from moe_policy.learning.clustering import cluster
from moe_policy.learning.training import fit_mixture
from tests.synthetic import fake_samples
from tests.trainings import QUICK


@pytest.fixture(scope="module")
def samples():
    return fake_samples()


@pytest.fixture(scope="module")
def pretrained(samples):
    return fit_mixture(samples, cluster(samples, "custom"), settings=QUICK)
