import numpy as np
import pytest

from moe_policy.experiments.figures.style import METHODS, looks, save_figure


def test_variants_share_the_colour_of_their_policy():
    names = ["optimal", "snn", "moe-custom", "snn, half turn", "snn, radius + 0.1", "moe-custom, half turn"]
    found = looks([*names, "snn"])
    assert list(found) == names
    colors = [found[name]["color"] for name in names]
    assert len(set(colors)) == 3
    assert colors[1] == colors[3] == colors[4]
    assert colors[2] == colors[5]
    assert len({tuple(look.values()) for look in found.values()}) == len(names)


def test_a_method_has_the_same_colour_whoever_is_compared_with_it():
    few, many = looks(["snn", "moe-kmeans-4", "stabiliser"]), looks(["optimal", "moe-kmeans-10", "mine", "snn", "ppo"])
    assert few["snn"] == many["snn"]
    assert few["moe-kmeans-4"] == many["moe-kmeans-10"]
    assert many["mine"]["color"] not in METHODS.values()


def test_figures_keep_their_colours(tmp_path):
    pytest.importorskip("matplotlib")
    from PIL import Image

    def stripes(figure):
        axes = figure.subplots()
        axes.imshow([[[1, 1, 1], [0.8, 0.1, 0.2], [0, 0, 1]]], aspect="auto", interpolation="nearest")
        axes.set_axis_off()

    with Image.open(save_figure(tmp_path / "figure.png", (3, 1), stripes)) as image:
        middle = image.size[1] // 2
        found = [image.convert("RGB").getpixel((round(image.size[0] * x), middle)) for x in (1 / 6, 1 / 2, 5 / 6)]
        assert image.mode == "P"
        assert image.info["dpi"] == pytest.approx((160, 160), abs=0.1)
    np.testing.assert_allclose(found, [(255, 255, 255), (204, 26, 51), (0, 0, 255)], atol=1)


def test_a_failed_figure_leaves_the_old_file(tmp_path):
    pytest.importorskip("matplotlib")
    path = tmp_path / "figure.png"
    path.write_bytes(b"old")

    def broken(figure):
        raise RuntimeError("no")

    with pytest.raises(RuntimeError):
        save_figure(path, (2, 2), broken)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
