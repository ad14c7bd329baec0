"""Time rollouts of tracked plans, planning and LQR included, against a loop over single episodes.

Both sides use the same shipped planner, the same tracking policy and the same initial conditions. The alternative is
what one writes without batching: plan, compute the gains and step one ``gymnasium.make`` environment at a time. It runs
on fewer episodes, and the times per episode are compared. The aims, for 10,000 episodes on one core, are 2 s for the
vehicle and 15 s for the quadcopter, in 1 GB of memory. Writes ``benchmark_rollout_<env>.json``.

    python scripts/benchmark_rollout.py --env GroundVehicle-v0 --episodes 10000
"""

from statistics import median

import numpy as np

import moe_policy
from moe_policy.experiments import cli
from moe_policy.experiments.speed.environments import DT, Batched, RolloutSpeed, batched, one_by_one, peak_memory_gb
from ocp_envs.support.provenance import provenance


def main() -> None:
    parser = cli.parser(__doc__, seed=0)
    parser.add_argument("--planner", default="moe-custom", help="name of a shipped planner")
    parser.add_argument("--episodes", type=cli.positive, default=1000, help="episodes of the batched rollout")
    parser.add_argument("--batch", type=cli.positive, default=1000, help="episodes that run at once; default 1000")
    parser.add_argument("--single", type=cli.positive, default=20, help="episodes of the loop over single environments")
    parser.add_argument("--repeats", type=cli.positive, default=3, help="runs of each, interleaved; the median counts")
    arguments = parser.parse()

    problem, count, few = arguments.problem, arguments.episodes, arguments.single
    cli.at_most(few, count, "episodes", "--single")
    cli.threads()
    cli.one_core()
    size = min(arguments.batch, count)
    with cli.option("--planner"):
        planner = moe_policy.load_planner(problem, arguments.planner)
    p = problem.parameters.draw(np.random.default_rng(arguments.seed), count)
    runs = [
        (batched(problem, planner, p, size), one_by_one(problem, planner, p[:few])) for _ in range(arguments.repeats)
    ]
    times = [seconds for (seconds, _), _ in runs]
    together = Batched(
        planning=median(t.planning for t in times),
        tracking_setup=median(t.tracking_setup for t in times),
        whole=median(t.whole for t in times),
    )
    alone = median(seconds for _, (seconds, _) in runs) / few
    record = RolloutSpeed(
        env_id=problem.id,
        planner=arguments.planner,
        episodes=count,
        dt=DT,
        seed=arguments.seed,
        repeats=arguments.repeats,
        successes=int(runs[-1][0][1].sum()),
        batched_seconds=together,
        batched_seconds_per_episode=together.whole / count,
        single_episodes=few,
        single_seconds_per_episode=alone,
        ratio=alone / (together.whole / count),
        same_successes=all(bool(np.array_equal(many[:few], one)) for (_, many), (_, one) in runs),
        environments=size,
        peak_memory_gb=peak_memory_gb(),
        provenance=provenance(),
    )
    cli.publish(arguments, f"benchmark_rollout_{problem.id}", record)
    parts = f"planning {together.planning:.3f} s and gains {together.tracking_setup:.2f} s of it"
    cli.say(f"{count} tracked plans, batched: {together.whole:.2f} s ({parts})")
    cli.say(f"peak memory: {peak_memory_gb():.2f} GB")
    cli.say(f"one environment at a time: {1e3 * alone:.1f} ms an episode, {record.ratio:.0f} times as long")


if __name__ == "__main__":
    cli.run(main)
