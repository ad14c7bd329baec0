"""The worked example: short enough to read, on a page of the documentation word for word, and it runs."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "scripts" / "example_cartpole.py"


def test_the_example_is_short_and_stands_in_the_documentation():
    code = EXAMPLE.read_text()
    assert len(code.splitlines()) <= 80
    page = (ROOT / "docs" / "example.md").read_text()
    shown = re.findall(r"<!-- file: scripts/example_cartpole\.py -->\n```python\n(.*?)```", page, re.DOTALL)
    assert shown == [code]


#: The example, with two guesses to every winding and few episodes instead of the usual numbers.
HASTY = """
import functools, runpy, sys
import moe_policy, ocp_envs
from ocp_envs.data.settings import GenerationSettings
ocp_envs.generate = functools.partial(ocp_envs.generate, settings=GenerationSettings(starts=2))
few = dict(clusters=(2,), development=20, test=50)
moe_policy.compare = functools.partial(moe_policy.compare, **few)
runpy.run_path(sys.argv.pop(1), run_name="__main__")
"""


def test_the_example_runs_from_declaration_to_rollouts(tmp_path):
    options = ["--problems", "60", "--epochs", "60", "--data", str(tmp_path)]
    # Without a compiler: what it takes to compile is more than what it saves here.
    environment = os.environ | {"PATH": os.path.dirname(sys.executable), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", HASTY, str(EXAMPLE), *options],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=environment,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    found = dict(re.findall(r"\| (\S+) +\| \d+ of 50 +\| (\d+) of 50", done.stdout))
    assert {"optimal", "snn", "moe-custom"} <= set(found)
    assert int(found["optimal"]) > 48
