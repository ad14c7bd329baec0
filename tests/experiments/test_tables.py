import numpy as np
import pytest

from moe_policy.experiments.figures.comparison import Outcome, comparison_figure
from moe_policy.experiments.figures.style import looks, save_figure
from moe_policy.experiments.tables import duration, keyed, markdown_table, proportion, text_table
from moe_policy.rollouts.intervals import Proportion

ROWS = [
    {"name": "optimal", "success": Proportion(1000, 1000), "error": 0.00123},
    {"name": "a|b", "success": Proportion(0, 1000), "error": None},
    {"name": "sac", "success": Proportion(985, 1000), "error": float("nan")},
]
COLUMNS = [keyed("name", "policy"), keyed("success", "success", proportion), keyed("error", "error", ".2e")]


def test_missing_keys_are_dashes():
    assert markdown_table([{"x": 1}, {}], [keyed("x", "x")]).splitlines()[-2:] == ["| 1 |", "| – |"]


def test_columns_without_a_value_are_left_out():
    assert markdown_table(ROWS, [*COLUMNS, keyed("nowhere", "nothing")]) == markdown_table(ROWS, COLUMNS)
    assert text_table(ROWS, [keyed("nowhere", "nothing"), *COLUMNS]) == text_table(ROWS, COLUMNS)
    assert "nothing" in text_table([], [keyed("nowhere", "nothing")])


def test_markdown():
    assert markdown_table(ROWS, COLUMNS).splitlines() == [
        "| policy | success | error |",
        "| --- | ---: | ---: |",
        "| optimal | 1000 (99.6–100.0 %) | 1.23e-03 |",
        "| a\\|b | 0 (0.0–0.4 %) | – |",
        "| sac | 985 (97.5–99.1 %) | – |",
    ]


def test_text_is_aligned():
    lines = text_table(ROWS, COLUMNS).splitlines()
    assert lines[0].split() == ["policy", "success", "error"]
    assert len({len(line) for line in lines}) == 1
    assert lines[2].startswith("optimal  ")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(3.2e-7, "0.32 µs"), (1.23e-5, "12.3 µs"), (0.00456, "4.56 ms"), (7.89, "7.89 s"), (738, "12.3 min")],
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_variants_share_the_colour_of_their_policy():
    names = ["optimal", "snn", "moe-custom", "snn, half turn", "snn, radius + 0.1", "moe-custom, half turn"]
    found = looks([*names, "snn"])
    assert list(found) == names
    colors = [found[name]["color"] for name in names]
    assert len(set(colors)) == 3
    assert colors[1] == colors[3] == colors[4]
    assert colors[2] == colors[5]
    assert len({tuple(look.values()) for look in found.values()}) == len(names)


def test_comparison_figure_is_a_png(tmp_path):
    pytest.importorskip("matplotlib")
    errors = np.random.default_rng(0).lognormal(-4, 1, 200)
    outcomes = [
        Outcome("optimal", Proportion(1000, 1000), Proportion(1000, 1000), errors),
        Outcome("SAC", Proportion(950, 1000)),
        Outcome("wild", Proportion(3, 1000), Proportion(1, 1000), np.full(5, np.nan)),
    ]
    path = comparison_figure(tmp_path / "new" / "comparison.png", outcomes, 0.1)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [p.name for p in path.parent.iterdir()] == ["comparison.png"]


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
