"""Values that fit the public classes of both packages, small enough to be made in milliseconds."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import moe_policy
import ocp_envs
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.solvers.nlp import Status
from tests.closed_loop import constant
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.synthetic import beyond_borders, fake_samples

P = np.array([[1.0, 0.5], [2.0, -0.5]])
SAMPLES = fake_samples(12, modes=3)
QUICK = moe_policy.TrainingSettings(epochs=1)
_COUNTER = itertools.count()
_FOLDER = Path(tempfile.gettempdir())


def use_folder(folder: Path) -> None:
    """Files that calls write are in ``folder``."""
    global _FOLDER
    _FOLDER = folder


def new_path() -> Path:
    """A path in the folder that does not exist."""
    return _FOLDER / f"{next(_COUNTER)}"


@cache
def database() -> ocp_envs.Database:
    return ocp_envs.Database.create(new_path(), DOUBLE_INTEGRATOR, np.zeros((2, 2)))


def constant_plans(p: np.ndarray) -> ocp_envs.Trajectory:
    """Plans of the double integrator that stay where they are."""
    count = len(p)
    states = np.repeat(p[:, None], DOUBLE_INTEGRATOR.knots, axis=1)
    return ocp_envs.Trajectory(states, np.zeros((count, DOUBLE_INTEGRATOR.knots - 1, 1)), np.ones(count))


@cache
def finished() -> ocp_envs.Database:
    """A database of one instance that was not solved."""
    made = ocp_envs.Database.create(new_path(), DOUBLE_INTEGRATOR, np.ones((1, 2)))
    shape = (1, 1, DOUBLE_INTEGRATOR.flat_size)
    nothing = np.zeros(1, np.int32)
    rows = ocp_envs.StoredRows(
        status=np.full(1, Status.NOT_CONVERGED, np.int8),
        slot_status=np.zeros((1, 1), np.int8),
        cost=np.full((1, 1), np.inf),
        z=np.full(shape, np.nan),
        multipliers=np.empty((1, 1, DOUBLE_INTEGRATOR.knots, 0)),
        solves=nothing,
        failures=nothing,
        fallbacks=nothing,
        iterations=nothing,
    )
    made.write(0, rows)
    return made


@cache
def planner() -> moe_policy.NetworkPlanner:
    return moe_policy.fit_mixture(SAMPLES, moe_policy.cluster(SAMPLES, "custom"), settings=QUICK)


@cache
def episodes() -> moe_policy.Episodes:
    return moe_policy.rollout(moe_policy.environments(PENDULUM, 2), constant(0.0), P, horizon=0.1)


@cache
def actor() -> moe_policy.Actor:
    return moe_policy.Actor((np.ones((8, 3)), np.ones((1, 8))), (np.zeros(8), np.zeros(1)), "relu", "tanh")


@cache
def policy() -> moe_policy.TrackingPolicy:
    return moe_policy.TrackingPolicy(PENDULUM, moe_policy.NearestPlanner(SAMPLES))


@cache
def evaluation() -> moe_policy.Evaluation:
    values = dict.fromkeys(("success", "reached", "steps"), 1)
    numbers = dict.fromkeys(
        ("cost", "score", "cost_ratio", "mean_return", "violation", "final_error", "seconds", "closest"), 1.0
    )
    return moe_policy.Evaluation(**values, **numbers)


@cache
def solutions() -> ocp_envs.Solutions:
    return ocp_envs.Solutions.empty(PENDULUM, 2)


def optima() -> ocp_envs.Optima:
    return ocp_envs.Optima(PENDULUM, [ocp_envs.Solution(P[0], solutions(), Status.EMPTY)])


@cache
def checked_plans() -> moe_policy.CheckedPlans:
    return moe_policy.Checked(planner(), repair=moe_policy.Repair(rounds=0)).check(P)


def comparison() -> moe_policy.Comparison:
    metrics = moe_policy.evaluate(PENDULUM, episodes())
    return moe_policy.Comparison(PENDULUM, {"snn": planner()}, {"snn": metrics}, {"snn": 1}, "snn", (12, 2, 2))


def step() -> ocp_envs.Step:
    return ocp_envs.Simulator(PENDULUM, 0.02).advance(P, np.zeros((2, 1)), np.zeros((2, 0)))


def part() -> moe_policy.PartReport:
    return moe_policy.PartReport("expert 0", 2, 1, (1.0, 0.5), (1.0, 0.6), 2, 0.6, 0.1)


def sac() -> moe_policy.SACSettings:
    return moe_policy.SACSettings(
        steps=8, learning_starts=4, gradient_steps=1, n_envs=2, hidden=(4,), evaluate_every=8, batch_size=4, period=0.2
    )


def score_run() -> moe_policy.ScoreRun:
    metrics = {"uniform": moe_policy.evaluate(PENDULUM, episodes())}
    return moe_policy.ScoreRun(seed=None, making_seconds=0.0, parameters_total=None, splits=metrics)


def score() -> moe_policy.Score:
    return moe_policy.Score(
        env_id=PENDULUM.id,
        method="name",
        factory="module:make",
        kind="planner",
        dt=0.02,
        cases={"uniform": 2},
        optimal_solved={"uniform": 2},
        runs=(score_run(),),
        seconds=1.0,
        provenance=where(),
    )


def where() -> ocp_envs.Provenance:
    return ocp_envs.Provenance("2026-01-01", None, "3.11", "Linux", "x", 2, {"numpy": "2"})


@cache
def minari_id() -> str:
    """The id of a dataset of one episode, in the folder."""
    name = f"ocp/doors{next(_COUNTER)}-v0"
    moe_policy.export_minari(PENDULUM, policy(), [[3.0, 0.0]], name)
    return name


def learned() -> moe_policy.LearnedPolicy:
    return moe_policy.LearnedPolicy(PENDULUM, actor(), period=0.1)


def _in_the_right_half(p: Any) -> Any:
    return p[:, 0] > 0


def _in_the_middle(rng: np.random.Generator) -> Any:
    return [0.0, 0.0]


def unsolved(p: Any, guess: Any) -> Any:
    return guess, np.full(len(p), np.inf)


#: A value of each dataclass whose fields depend on each other.
VALUES: dict[str, Callable[[], Any]] = {
    "Actor": actor,
    "Architecture": lambda: moe_policy.Architecture((4,), (4,), moe_policy.Experts((4,), (4,))),
    "Ball": lambda: ocp_envs.Ball([0.0, 0.0], 1.0),
    "Blocked": lambda: QUADCOPTER_OBSTACLE.distribution,
    "Beyond": lambda: beyond_borders(SAMPLES, SAMPLES.mode, [0]),
    "Belief": lambda: moe_policy.Estimated(policy()).start(P).belief,
    "Box": lambda: PENDULUM.parameters,
    "Between": lambda: ocp_envs.Between(0.0, 1.0),
    "Conditioned": lambda: ocp_envs.Conditioned(_in_the_right_half),
    "Coordinate": lambda: ocp_envs.Coordinate("x", -1.0, 1.0, "m", 1.0, None),
    "CheckedPlans": checked_plans,
    "Checkup": lambda: ocp_envs.Checkup(PENDULUM, [ocp_envs.Finding("goal", "well", "held")], optima()),
    "Comparison": comparison,
    "Failure": lambda: ocp_envs.Failure("guess", "no guess is finite", SAMPLES.trajectory[:1]),
    "Finding": lambda: ocp_envs.Finding("goal", "well", "held"),
    "CostRatio": lambda: moe_policy.CostRatio(1.1, 3),
    "EnvOptions": lambda: ocp_envs.EnvOptions(PENDULUM),
    "Episodes": episodes,
    "Evaluation": evaluation,
    "Experts": lambda: moe_policy.Experts((4,), (4,)),
    "Estimating": lambda: moe_policy.Estimated(policy()).start(P),
    "Entered": lambda: moe_policy.Entered(None, np.zeros(2, bool)),
    "Face": lambda: ocp_envs.Face(np.eye(3)),
    "Goal": lambda: PENDULUM.goal,
    "Held": lambda: moe_policy.Held(np.zeros((2, 1)), np.zeros(2, np.int64)),
    "Interface": lambda: ocp_envs.Env(PENDULUM).interface,
    "Labels": lambda: moe_policy.cluster(SAMPLES, "custom"),
    "Line": lambda: ocp_envs.Line(np.eye(2)),
    "Linearisation": lambda: PENDULUM.functions.linearisation(1),
    "Margin": lambda: moe_policy.Margin("radius", 0.1),
    "Mean": lambda: moe_policy.Mean(1.0, 3, (0.5, 1.5)),
    "Metrics": lambda: moe_policy.evaluate(PENDULUM, episodes()),
    "MixtureOfExperts": lambda: planner().network,
    "Modes": lambda: PENDULUM.modes,
    "NetworkPlanner": planner,
    "OnTheWay": lambda: ocp_envs.OnTheWay(SAMPLES.trajectory, np.zeros((len(SAMPLES.trajectory), 0)), [0.1, 0.1]),
    "Normal": lambda: ocp_envs.Normal([0.0, 0.0], [1.0, 1.0]),
    "Optima": optima,
    "OptimalControlProblem": lambda: DOUBLE_INTEGRATOR,
    "Parametrisation": lambda: ocp_envs.Parametrisation("a", PENDULUM.parameters, PENDULUM.system.state, np.zeros(2)),
    "PartReport": part,
    "Performance": lambda: moe_policy.Performance.of(PENDULUM, episodes()),
    "Picture": lambda: PENDULUM.picture,
    "Proportion": lambda: moe_policy.Proportion(1, 3),
    "Provenance": where,
    "ReferenceSet": lambda: ocp_envs.ReferenceSet(P, np.ones((2, 3))),
    "Refinement": lambda: ocp_envs.Refinement(finished(), np.ones((1, 1)), np.ones((1, 1))),
    "SACSettings": sac,
    "Sampler": lambda: ocp_envs.Sampler(_in_the_middle),
    "Samples": lambda: SAMPLES,
    "Score": score,
    "ScoreRun": score_run,
    "Schedule": lambda: policy().start(P).schedule,
    "SingleNetwork": lambda: planner().network.gate,
    "Solution": lambda: ocp_envs.Solution(P[0], solutions(), Status.EMPTY),
    "Solutions": solutions,
    "Standardizer": lambda: planner().inputs,
    "Step": step,
    "StoredRows": lambda: database().stored(slice(0, 2)),
    "Symmetry": lambda: PENDULUM.symmetry or ocp_envs.Symmetry("turn", np.eye(2), np.eye(1), np.eye(0)),
    "System": lambda: PENDULUM.system,
    "Table": lambda: ocp_envs.Table(P),
    "Renewed": lambda: moe_policy.Replanning(moe_policy.NearestPlanner(SAMPLES)).start(P),
    "Tracking": lambda: policy().start(P),
    "TrackingWeights": lambda: moe_policy.TrackingWeights.default(PENDULUM),
    "TrainingReport": lambda: moe_policy.TrainingReport((part(),), 0.5),
    "TrainingRun": lambda: moe_policy.TrainingRun(sac(), learned(), evaluation()),
    "Transitions": lambda: moe_policy.Transitions(np.zeros((3, 2)), np.zeros((3, 1)), np.zeros(3, np.int64)),
    "Trajectory": lambda: SAMPLES.trajectory[:2],
    "Verdict": lambda: checked_plans().verdicts[0],
    "Violation": lambda: moe_policy.Violation(moe_policy.Mean(1.0, 3, (0.5, 1.5)), 1.0, 2.0),
}
