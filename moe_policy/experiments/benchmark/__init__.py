"""What the experiments do with each problem, as one value: :func:`benchmark_of`.

All scripts take their lists from it, so that a name means the same planner everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from moe_policy.experiments.benchmark import cart_pole, pendulum, quadcopter, rocket, uncertain_pendulum, vehicle
from moe_policy.experiments.benchmark.parts import Benchmark
from moe_policy.experiments.perturbations import of_every_constant
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems.cart_pole import CART_POLE
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.rocket import ROCKET
from ocp_envs.problems.uncertain_pendulum import UNCERTAIN_PENDULUM
from ocp_envs.problems.vehicle import VEHICLE

#: By id of the problem.
BENCHMARKS: Mapping[str, Benchmark] = MappingProxyType(
    {
        PENDULUM.id: pendulum.BENCHMARK,
        VEHICLE.id: vehicle.BENCHMARK,
        QUADCOPTER.id: quadcopter.BENCHMARK,
        QUADCOPTER_OBSTACLE.id: quadcopter.WITH_OBSTACLE,
        UNCERTAIN_PENDULUM.id: uncertain_pendulum.BENCHMARK,
        CART_POLE.id: cart_pole.BENCHMARK,
        ROCKET.id: rocket.BENCHMARK,
    }
)


def benchmark_of(problem: OptimalControlProblem) -> Benchmark:
    """The benchmark of ``problem``.

    A problem of the user has a single network and a mixture over its solution families, and perturbations of every
    constant of its system.
    """
    if problem.id in BENCHMARKS:
        return BENCHMARKS[problem.id]
    return Benchmark(short=problem.id.lower(), perturbations=of_every_constant(problem))
