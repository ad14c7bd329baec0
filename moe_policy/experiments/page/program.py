"""Regulators and simulator of a problem as a WebAssembly program.

The regulators are the exported C of a tracking policy (:meth:`~moe_policy.control.tracking.TrackingPolicy.to_c`), the
simulator is the C of its control step; ``source/c/episode.c`` joins them. They are compiled for the browser with clang
and lld.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import casadi as ca

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments.running import UsageError
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.clock import count_steps
from ocp_envs.support.programs import written

#: Arrays and functions that the page uses by name; see ``source/c/episode.c``.
EXPORTS = (
    *("parameters", "plan", "states", "context"),
    *("controls", "costs", "left_box", "errors", "least_clearance", "episode"),
)
#: Fused operations would round otherwise than Python does.
FLAGS = (
    *("--target=wasm32", "-Os", "-ffreestanding", "-ffp-contract=off", "-mbulk-memory", "-nostdlib", "-w"),
    *("-Wl,--no-entry", "-Wl,--gc-sections", "-Wl,--strip-all", "-Wl,--allow-undefined", "-Wl,-z,stack-size=131072"),
)


def program(policy: TrackingPolicy, sources: Path) -> bytes:
    """The program for ``policy``, of the C in the folder ``sources``.

    Raises:
        UsageError: no clang, no lld, or one that fails.
    """
    if shutil.which("clang") is None or shutil.which("wasm-ld") is None:
        raise UsageError("building the page needs clang and lld for WebAssembly: apt-get install clang lld")
    with tempfile.TemporaryDirectory() as name:
        folder, functions = Path(name), _functions(policy)
        (folder / "functions.c").write_text(written(functions, "functions"))
        files = [policy.to_c(folder), folder / "functions.c", sources / "episode.c"]
        sizes = {**_sizes(policy), "WORK": max(function.sz_w() for function in functions) + 1}
        command = [
            *("clang", *FLAGS, "-I", sources / "include", "-I", folder),
            *(f"-D{macro}={value}" for macro, value in sizes.items()),
            *(f"-Wl,--export={export}" for export in EXPORTS),
            *(*files, "-o", folder / "program.wasm"),
        ]
        made = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
        if made.returncode:
            raise UsageError(f"clang cannot build the program of {policy.problem.id}:\n{made.stderr[-2000:]}")
        return (folder / "program.wasm").read_bytes()


def longest(problem: OptimalControlProblem, dt: float) -> int:
    """Control steps of ``dt`` seconds of the longest episode: the longest plan, and the time that its goal is held."""
    return int(count_steps(problem.horizon.longest, dt) + count_steps(problem.hold, dt))


def _sizes(policy: TrackingPolicy) -> dict[str, int]:
    problem = policy.problem
    return {
        "NX": problem.system.nx,
        "NU": problem.system.nu,
        "NC": len(problem.context),
        "CLEARANCES": problem.n_clearances,
        "STEPS": longest(problem, policy.dt),
    }


def _functions(policy: TrackingPolicy) -> list[ca.Function]:
    """The functions of the problem that an episode calls."""
    problem = policy.problem
    x, _, s = problem.symbols()
    error = ca.Function("goal_error", [x, s], [ca.sqrt(problem.terminal.squared_error(x, s))])
    clearances = ca.Function("clearances", [x, s], [ca.densify(problem.clearances(x, s))])
    return [Simulator(problem, policy.dt).step_function, error, clearances]
