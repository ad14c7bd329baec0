import numpy as np
import pytest

from moe_policy.experiments.figures.comparison import comparison_figure
from tests.experiments.test_overview import row


def test_comparison_figure_is_a_png(tmp_path):
    pytest.importorskip("matplotlib")
    errors = np.random.default_rng(0).lognormal(-4, 1, 200)
    rows = [row("optimal", 10, 10), row("sac", 9, None), row("wild", 3, 1)]
    path = comparison_figure(
        tmp_path / "new" / "comparison.png",
        {row.name: row.metrics for row in rows},
        {"optimal": errors, "sac": np.full(200, np.nan), "wild": np.full(5, np.nan)},
        0.1,
    )
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [p.name for p in path.parent.iterdir()] == ["comparison.png"]
