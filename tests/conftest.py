import dataclasses
import sys

import pytest
from hypothesis import settings

from ocp_envs.support import progress
from tests.synthetic import fake_samples

# Wall time says nothing about correctness, and machines are busy.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(autouse=True)
def _progress_is_not_shown():
    """A command that a test runs in this process decides how it shows progress; the next test starts anew."""
    progress.show(None)


@pytest.fixture(scope="module")
def interpreted():
    """Solver functions are interpreted: compiling those of a quadcopter takes half a minute, a few solves seconds."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv("CC", "none")
        yield


@pytest.fixture(scope="session")
def samples_of_three_modes():
    """Synthetic samples of the pendulum in three solution families."""
    return fake_samples(count=150, modes=3)


@pytest.fixture(scope="session")
def planners(samples_of_three_modes):
    """A briefly trained planner of every kind: single, mixture with argmax and with softmax, nearest."""
    from moe_policy.learning.clustering import cluster
    from moe_policy.learning.settings import TrainingSettings
    from moe_policy.learning.training import fit_mixture, fit_single
    from moe_policy.planners.nearest import NearestPlanner
    from moe_policy.planners.networks import Softmax

    samples, quick = samples_of_three_modes, TrainingSettings(epochs=3)
    mixture = fit_mixture(samples, cluster(samples, "custom"), settings=quick)
    return {
        "single": fit_single(samples, settings=quick),
        "mixture": mixture,
        "soft": dataclasses.replace(mixture, mixing=Softmax(0.3)),
        "nearest": NearestPlanner(samples),
    }


@pytest.fixture
def drawn(monkeypatch):
    """Calls a function that draws a figure, and returns its Matplotlib figure instead of a file."""
    from matplotlib.figure import Figure

    made = []

    def capture(path, size, draw):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        made.append(figure)
        return path

    def call(function, *arguments, **options):
        monkeypatch.setattr(sys.modules[function.__module__], "save_figure", capture)
        function("unused.png", *arguments, **options)
        return made[-1]

    return call
