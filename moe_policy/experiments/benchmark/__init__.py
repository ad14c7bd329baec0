"""What the experiments do with each problem, as one value: :func:`benchmark_of`.

All scripts take their lists from it, so that a name means the same planner everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from moe_policy.experiments.benchmark import further, pendulum, quadcopter, vehicle
from moe_policy.experiments.benchmark.parts import Benchmark
from moe_policy.experiments.perturbations import of_every_constant
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems.arm import TWO_LINK_ARM
from ocp_envs.problems.cart_pole import CART_POLE
from ocp_envs.problems.discs import PLANAR_QUADCOPTER
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.recovery import QUADCOPTER_RECOVERY
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
        UNCERTAIN_PENDULUM.id: further.UNCERTAIN_PENDULUM,
        CART_POLE.id: further.CART_POLE,
        ROCKET.id: further.ROCKET,
        TWO_LINK_ARM.id: further.TWO_LINK_ARM,
        PLANAR_QUADCOPTER.id: further.PLANAR_QUADCOPTER,
        QUADCOPTER_RECOVERY.id: further.QUADCOPTER_RECOVERY,
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
