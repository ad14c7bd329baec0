from __future__ import annotations

import numpy as np
import pytest

from moe_policy.experiments.figures import clusters, errors
from moe_policy.experiments.figures.style import COLORS, METHODS, STYLE
from moe_policy.learning.clustering import cluster
from moe_policy.planners.nearest import NearestPlanner
from tests.synthetic import fake_samples

image = pytest.importorskip("matplotlib.image")
SAMPLES = fake_samples(count=60, modes=3)


@pytest.fixture(autouse=True)
def _no_legends(monkeypatch):
    """Colours in a picture are those of the data alone."""
    for owner in (pytest.importorskip("matplotlib.axes").Axes, pytest.importorskip("matplotlib.figure").Figure):
        monkeypatch.setattr(owner, "legend", lambda *_, **__: None)


def pixels(path, inches):
    """The picture (H, W, 3); its size must be that of the figure."""
    assert path.read_bytes().startswith(b"\x89PNG")
    read = image.imread(path)[..., :3]
    assert read.shape[1::-1] == tuple(round(length * STYLE["savefig.dpi"]) for length in inches)
    return read


def has(picture, color):
    wanted = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return bool((np.abs(picture - wanted).max(axis=-1) < 0.02).any())


def test_the_jump(tmp_path):
    optimal = SAMPLES.trajectory[0]
    plans = {"snn": SAMPLES.trajectory[1], "moe-custom": NearestPlanner(SAMPLES)(SAMPLES.parameters[:1])}
    labels = cluster(SAMPLES, "custom")
    path = clusters.discontinuity_figure(tmp_path / "new" / "jump.png", SAMPLES, labels, optimal, plans)
    picture = pixels(path, (9.0, 6.5))
    below, middle = (length // 2 for length in picture.shape[:2])
    assert all(has(picture[below:, :middle], color) for color in (*COLORS[:3], "#d62728"))  # three clusters, the goals
    for name, prediction in {"snn": picture[:below, middle:], "moe-custom": picture[below:, middle:]}.items():
        assert all(has(prediction, METHODS[method]) for method in ("optimal", name))
    assert [file.name for file in path.parent.iterdir()] == ["jump.png"]


def test_clusters(tmp_path):
    partitions = {"custom": cluster(SAMPLES, "custom"), "k-means 2": cluster(SAMPLES, "kmeans", k=2)}
    picture = pixels(clusters.clusters_figure(tmp_path / "clusters.png", SAMPLES, partitions), (6.4, 3.0))
    middle = picture.shape[1] // 2
    left, right = picture[:, : middle - 80], picture[:, middle + 120 :]  # the first panel has the labels
    assert [has(left, color) for color in COLORS[:4]] == [True, True, True, False]
    assert [has(right, color) for color in COLORS[:4]] == [True, True, False, False]


@pytest.mark.parametrize(("models", "height"), [(2, 2.4), (4, 4.8)])
def test_errors_show_failures_in_their_own_colour(tmp_path, models, height):
    predicted = np.full(20, 0.02)
    good = {f"good {i}": (predicted, np.full(20, 1e-6)) for i in range(models)}
    picture = pixels(errors.error_figure(tmp_path / "good.png", good, 0.1), (9.0, height))
    assert not has(picture, COLORS[1])
    # An error that is not a number is a failure, too.
    one_bad = good | {"good 0": (predicted, np.array([*[1e-6] * 18, 0.5, np.nan]))}
    picture = pixels(errors.error_figure(tmp_path / "bad.png", one_bad, 0.1), (9.0, height))
    assert has(picture, COLORS[0])
    assert has(picture, COLORS[1])
