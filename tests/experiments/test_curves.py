"""Curves and intervals over seeds."""

import dataclasses
import json

import numpy as np
import pytest

from moe_policy.experiments.curves import band, learner_record, learner_runs, over_seeds
from moe_policy.rl.settings import PPOSettings, SACSettings
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE

# -- over seeds --------------------------------------------------------------------------------------------------------


def line(begin, end, step, slope):
    steps = list(range(begin, end + 1, step))
    return {"steps": steps, "success": [slope * s for s in steps]}


def test_straight_curves_stay_straight_on_common_points():
    points, values = over_seeds([line(10, 100, 10, 1.0), line(15, 90, 25, 2.0)], "steps", "success")
    assert points[0] >= 15
    assert points[-1] == 90 or points[-1] == 100
    np.testing.assert_allclose(values[0], points)
    np.testing.assert_allclose(values[1], 2 * np.minimum(points, 90))  # it ended there and keeps its figure


def test_equal_points_are_kept_as_they_are():
    curves = [line(10, 50, 10, slope) for slope in (1.0, 5.0, 2.0)]
    points, values = over_seeds(curves, "steps", "success")
    np.testing.assert_array_equal(points, curves[0]["steps"])
    np.testing.assert_array_equal(values, [curve["success"] for curve in curves])
    np.testing.assert_allclose(band(values), np.outer([1.0, 2.0, 5.0], points))


def test_what_was_not_kept_is_left_out():
    whole, late, none = line(10, 40, 10, 1.0), line(10, 40, 10, 3.0), line(10, 40, 10, 1.0)
    late["success"][:2] = [None, None]
    none["success"] = [None] * 4
    _, values = over_seeds([whole, late, none], "steps", "success")
    assert values.shape == (2, 4)
    np.testing.assert_array_equal(np.isnan(values[1]), [True, True, False, False])
    np.testing.assert_array_equal(band(values)[1], [10, 20, 60, 80])
    assert over_seeds([none], "steps", "success")[0].size == 0


# -- learners ----------------------------------------------------------------------------------------------------------


def a_run(settings, successes, **more):
    curve = [
        {"steps": 100 * (i + 1), "seconds": 2.0 * (i + 1), "success": s, "reached": s, "cost": None, "score": 1.0}
        for i, s in enumerate(successes)
    ]
    return {
        "algorithm": settings.algorithm,
        "settings": dataclasses.asdict(settings),
        "steps": curve[-1]["steps"],
        "seconds": curve[-1]["seconds"],
        "curve": curve,
        "development": {"set": "development", "count": 50},
        **more,
    }


def write(folder, name, record):
    (folder / f"{name}.json").write_text(json.dumps(record))


def test_records_are_found_by_algorithm_and_seed(tmp_path):
    for seed, suffix in ((0, ""), (10, "_seed10"), (2, "_seed2")):
        run = a_run(SACSettings(steps=200, seed=seed), [1, seed])
        write(tmp_path, f"training_sac_{PENDULUM.id}{suffix}", run)
    old = a_run(PPOSettings(steps=200), [25, 50])
    del old["settings"]["violation_price"]  # an old record lacks what came later
    write(tmp_path, f"training_ppo_{PENDULUM.id}", old)
    write(tmp_path, f"training_ppo_{VEHICLE.id}", old)
    found = learner_runs(tmp_path, PENDULUM)
    assert list(found) == ["ppo", "sac"]
    assert [run["settings"]["seed"] for run in found["sac"]] == [0, 2, 10]
    record = learner_record(found["ppo"])
    assert record["curves"][0]["success"] == [0.5, 1.0]
    assert record["curves"][0]["cost_ratio"] == [None, None]
    assert record["simulated_seconds"] == [200 * 0.1]
    assert record["validation_success"] is None


def test_seeds_of_other_settings_are_refused(tmp_path):
    write(tmp_path, f"training_sac_{PENDULUM.id}", a_run(SACSettings(steps=200), [1, 2]))
    write(tmp_path, f"training_sac_{PENDULUM.id}_seed1", a_run(SACSettings(steps=200, gamma=0.9, seed=1), [1, 2]))
    with pytest.raises(ValueError, match=r"_seed1\.json has other settings .*: gamma 0\.995 and 0\.9"):
        learner_runs(tmp_path, PENDULUM)
