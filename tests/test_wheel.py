"""What is installed from a wheel works without the checkout."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from ocp_envs.problems import BENCHMARK
from ocp_envs.sets import reference

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("ocp_envs", "moe_policy")
needed = ("build", "hatchling")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not all(importlib.util.find_spec(name) for name in needed), reason=f"needs {' and '.join(needed)}"
    ),
]
#: Networks that only the comparison needs.
COMPARED_ALONE = (
    "GroundVehicle-v0/moe-kmeans-6",
    "QuadcopterObstacle-v0/moe-kmeans-8",
    "CartPoleSwingup-v0/moe-auto",
    "TwoLinkArm-v0/moe-kmeans-10",
    "PlanarQuadcopterDiscs-v0/moe-kmeans-8",
)
#: Run in an empty folder; arguments: the folder of the unpacked wheel, names of problems with reference sets.
CODE = """
import sys
from pathlib import Path

import gymnasium
import numpy as np

env = gymnasium.make("ocp_envs:PendulumSwingup-v0")
env.reset(seed=0)
env.step(env.action_space.sample())

import moe_policy
import ocp_envs
from ocp_envs.sets import reference

unpacked = Path(sys.argv[1]).resolve()
for package in (ocp_envs, moe_policy):
    assert Path(package.__file__).resolve().is_relative_to(unpacked), package.__file__
for name in ocp_envs.names():
    problem = ocp_envs.load(name)
    for model in moe_policy.available(name):
        loaded = moe_policy.load(name, model)
        if model != "optimal" and not isinstance(loaded, moe_policy.Policy):
            assert loaded(ocp_envs.sample(problem, 0, 5)).finite.all(), model
for name in sys.argv[2:]:
    for split in reference.SHIPPED:
        assert len(reference.load(ocp_envs.load(name), split)) > 0
assert "snn" in moe_policy.available("PendulumSwingup-v0")

from moe_policy.score.scoring import splits_of
from ocp_envs import info

assert splits_of("PendulumSwingup-v0") == ["uniform", "boundary", "near", "outside"]
info.main(["PendulumSwingup-v0"])
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    result = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    assert result.returncode == 0, result.stdout + result.stderr
    (path,) = folder.glob("*.whl")
    return path


def test_the_wheel_holds_the_packages_and_their_data_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as file:
        names = {name for name in file.namelist() if ".dist-info/" not in name}
    assert {name.partition("/")[0] for name in names} == set(PACKAGES)
    expected = set()
    code, data = (
        ("**/*.py", "**/*.[ch]", "*.pyi", "py.typed"),
        ("reference/**/*.npz", "models/**/*.safetensors", "models/**/*.json"),
    )
    for pattern in (*code, *data):
        for package in PACKAGES:
            expected |= {path.relative_to(ROOT).as_posix() for path in (ROOT / package).glob(pattern)}
    left_out = ("moe_policy/experiments/", *(f"moe_policy/models/{name}." for name in COMPARED_ALONE))
    expected = {name for name in expected if not name.startswith(left_out)}
    assert any(name.endswith(".npz") for name in expected)
    assert any(name.endswith(".safetensors") for name in expected)
    assert names == expected


def test_the_wheel_is_below_20_megabytes(wheel):
    assert wheel.stat().st_size < 20e6


def test_the_wheel_works_outside_the_checkout(wheel, tmp_path):
    unpacked, elsewhere = tmp_path / "unpacked", tmp_path / "elsewhere"
    elsewhere.mkdir()
    with zipfile.ZipFile(wheel) as file:
        file.extractall(unpacked)
    referenced = [p.id for p in BENCHMARK if all(reference.path_of(p, split).exists() for split in reference.SHIPPED)]
    result = subprocess.run(
        [sys.executable, "-c", CODE, str(unpacked), *referenced],
        cwd=elsewhere,
        env=os.environ | {"PYTHONPATH": str(unpacked)},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stderr
    assert list(elsewhere.iterdir()) == []
