"""A sketch of a mixture of experts."""

from __future__ import annotations

from pathlib import Path

from moe_policy.experiments.figures.style import COLORS, Figure, save_figure


def mixture_figure(path: str | Path, experts: int = 3) -> Path:
    """A sketch of a mixture: the gate sees p and chooses the expert that plans; the paper's figure 2."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.set(xlim=(0.2, 9.8), ylim=(-1.6, experts - 0.4), aspect="equal")
        axes.set_axis_off()

        def box(x: float, y: float, text: str, color: str) -> None:
            frame = {"boxstyle": "round,pad=0.5", "edgecolor": color, "facecolor": "white", "linewidth": 1.5}
            axes.text(x, y, text, ha="center", va="center", bbox=frame, fontsize=10)

        def arrow(start: tuple[float, float], end: tuple[float, float], color: str, **form: object) -> None:
            axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": color, "linewidth": 1.5, **form})

        middle, chosen, below = (experts - 1) / 2, min(1, experts - 1), -1.1
        box(0.8, middle, "p", "black")
        box(4.9, below, "gate", COLORS[1])
        arrow((0.8, middle - 0.45), (4.3, below), "black", connectionstyle="angle,angleA=90,angleB=0")
        for i in range(experts):
            color = COLORS[0] if i == chosen else COLORS[7]
            box(4.9, i, f"expert {i + 1}", color)
            arrow((1.2, middle), (3.9, i), color)
        arrow((5.9, chosen), (8.4, chosen), COLORS[0])
        arrow((5.5, below), (7.1, chosen), COLORS[1], linestyle="--", connectionstyle="angle,angleA=0,angleB=90")
        axes.text(7.25, below / 2 + 0.2, "chooses", color=COLORS[1], fontsize=9)
        box(9.1, chosen, "plan", "black")

    return save_figure(path, (6.0, 1.2 + 0.7 * experts), draw)
