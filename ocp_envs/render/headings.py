"""Headings that fit into the width of a figure, whatever their length."""

from __future__ import annotations

import textwrap

from ocp_envs.render.style import Artist, Figure

#: The part of the figure's width that a heading may take.
_ROOM = 0.96
#: Sizes in points and numbers of lines, tried in this order.
_STEPS = ((11.0, 1), (10.0, 1), (9.0, 1), (8.0, 1), (8.0, 2), (7.0, 2), (6.0, 2))


def heading(figure: Figure, height: float, words: str, color: str, largest: float = 11.0) -> Artist:
    """Write ``words`` in the middle of ``figure``, in ``color``.

    ``height`` is that of the middle of the text, as a fraction of the figure's. The letters have at most ``largest``
    points; longer words get smaller letters, then two lines. What is too long even then is cut and ends with "…".
    """
    text = figure.text(0.5, height, "", ha="center", va="center", color=color)
    for size, lines in [step for step in _STEPS if step[0] <= largest]:
        text.set_size(size)
        text.set_text(_wrapped(words, lines))
        if _fits(text):
            return text
    length = len(words)
    while not _fits(text):
        length = int(0.9 * length)
        text.set_text(_wrapped(f"{words[:length].rstrip()}…", 2))
    return text


def _fits(text: Artist) -> bool:
    return bool(text.get_window_extent().width <= _ROOM * text.figure.bbox.width)


def _wrapped(words: str, lines: int) -> str:
    """``words`` in at most so many ``lines``, which are about equally long."""
    width = max(1, -(-len(words) // lines))
    while len(broken := textwrap.wrap(words, width)) > lines:
        width += 1
    return "\n".join(broken)
