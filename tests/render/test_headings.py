"""Headings of pictures, drawn without a screen."""

import pytest

from ocp_envs.render.headings import heading

matplotlib = pytest.importorskip("matplotlib.figure")


@pytest.mark.parametrize(("words", "lines"), [("short", 1), ("park and stop at the goal " * 4, 2), ("on " * 400, 2)])
def test_long_headings_are_wrapped_and_what_is_too_long_even_then_ends_with_dots(words, lines):
    figure = matplotlib.Figure(figsize=(5, 5), dpi=96)
    text = heading(figure, 0.9, words.strip(), "black")
    assert len(text.get_text().splitlines()) == lines
    assert text.get_text().endswith("…") == (len(words) > 1000)
    assert text.get_size() >= 6
