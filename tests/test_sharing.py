"""Objects that calculate give the same results in threads, as copies, as pickles and in forked processes."""

import copy
import dataclasses
import multiprocessing
import pickle
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.control.lqr import Regulator
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.solvers.check import verify
from ocp_envs.support.batch import BatchFunction
from ocp_envs.support.pool import WorkerPool
from tests.in_process import Solver
from tests.plans import random_plan
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.synthetic import fake_samples
from tests.threads import in_threads

#: Seconds for a forked process.
LIMIT = 60


def parameters(problem, number):
    """Those of the call with a number: another batch in each."""
    return problem.parameters.draw(np.random.default_rng(number), 5 + 3 * number)


def rows(problem, number):
    """States, controls and contexts."""
    p = parameters(problem, number)
    states, contexts = problem.start(p)
    return states, problem.system.control.draw(np.random.default_rng(number), len(p)), contexts


def plan(problem):
    return lambda planner, number: [planner(parameters(problem, number)).flat()]


def predict(problem):
    def call(policy, number):
        states, _, contexts = rows(problem, number)
        observation, state, controls = np.concatenate([states, contexts], axis=1), None, []
        for _ in range(3):
            control, state = policy.predict(observation, state, deterministic=True)
            controls.append(control)
        return controls

    return call


def checked(problem, number):
    p, plans = parameters(problem, number), random_plan(problem, 5 + 3 * number, seed=number)[0]
    check = verify(problem, p, plans)
    return [check.defect, check.cost, check.path]


def linearised(regulator, number):
    return list(regulator.linearise(*rows(PENDULUM, number)))


def advanced(simulator, number):
    step = simulator.advance(*rows(simulator.problem, number))
    return [step.states, step.cost]


def with_step(linearisation, number):
    x, u, s = rows(PENDULUM, number)
    return list(linearisation(x, u, s, np.full((len(x), 1), 0.1)))


def tracking():
    return moe_policy.TrackingPolicy(PENDULUM, moe_policy.NearestPlanner(fake_samples()))


def solver_planner():
    return moe_policy.SolverPlanner(DOUBLE_INTEGRATOR, random_guesses=1, solver=Solver(DOUBLE_INTEGRATOR))


#: name → what makes the object, and (object, number) → arrays.
OBJECTS = {
    "network": (lambda: moe_policy.load(PENDULUM, "moe-custom"), plan(PENDULUM)),
    "nearest": (lambda: moe_policy.NearestPlanner(fake_samples()), plan(PENDULUM)),
    "symmetrised": (
        lambda: moe_policy.Symmetrised(QUADCOPTER_OBSTACLE, moe_policy.load(QUADCOPTER_OBSTACLE, "snn")),
        plan(QUADCOPTER_OBSTACLE),
    ),
    "margin": (
        lambda: moe_policy.WithMargin(QUADCOPTER_OBSTACLE, moe_policy.load(QUADCOPTER_OBSTACLE, "snn"), "radius", 0.05),
        plan(QUADCOPTER_OBSTACLE),
    ),
    "repaired": (lambda: moe_policy.Repaired(moe_policy.load(PENDULUM, "moe-custom"), 2), plan(PENDULUM)),
    "checked": (lambda: moe_policy.load(PENDULUM, "checked"), plan(PENDULUM)),
    "solver": (solver_planner, plan(DOUBLE_INTEGRATOR)),
    "tracking": (tracking, predict(PENDULUM)),
    "stabilised": (lambda: moe_policy.Stabilised(tracking(), PENDULUM), predict(PENDULUM)),
    "stabiliser": (lambda: moe_policy.Stabiliser(PENDULUM), predict(PENDULUM)),
    "learned": (lambda: moe_policy.load(PENDULUM, "ppo"), predict(PENDULUM)),
    "regulator": (lambda: Regulator(PENDULUM, 0.02), linearised),
    "simulator": (lambda: ocp_envs.Simulator(QUADCOPTER_OBSTACLE, 0.02), advanced),
    "problem": (lambda: QUADCOPTER_OBSTACLE, checked),
    "rate": (PENDULUM.functions.rate, lambda function, number: function(*rows(PENDULUM, number))),
    "linearisation": (lambda: PENDULUM.functions.linearisation(2), with_step),
}
each_object = pytest.mark.parametrize(("make", "call"), OBJECTS.values(), ids=OBJECTS)


def assert_equal(got, expected):
    for one, other in zip(got, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


@each_object
def test_threads_that_share_an_object_get_what_one_thread_gets(make, call):
    shared = make()
    expected = [call(shared, number) for number in range(4)]
    for _ in range(5):
        for got, own in zip(in_threads(lambda number: call(shared, number)), expected, strict=True):
            for one, other in zip(got, own, strict=True):
                np.testing.assert_array_equal(one, other)


@each_object
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_a_copy_gives_the_same(make, call, duplicate):
    original = make()
    assert_equal(call(duplicate(original), 0), call(original, 0))


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="needs fork")
@each_object
def test_a_forked_process_gets_the_same(make, call):
    shared = make()
    assert_equal(forked(lambda: call(shared, 2)), call(shared, 2))


def forked(call):
    """``call()`` in a forked process."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    process = context.Process(target=lambda: theirs.send(call()), daemon=True)
    process.start()
    try:
        assert ours.poll(LIMIT), "the forked process hangs"
        return ours.recv()
    finally:
        process.kill()
        process.join()


def episodes():
    policy = moe_policy.Stabiliser(PENDULUM)
    return moe_policy.rollout(moe_policy.environments(PENDULUM, 2), policy, [[3.0, 0.0], [1.0, 0.0]], horizon=0.1)


def solution():
    modes = ocp_envs.Solutions.empty(PENDULUM, len(PENDULUM.modes))
    return ocp_envs.Solution(np.array([1.0, 0.5]), modes, ocp_envs.Status.EMPTY, "nothing was tried")


def arrays(value):
    """All arrays of a result, those of its parts included."""
    parts = [getattr(value, field.name) for field in dataclasses.fields(value)]
    found = [part for part in parts if isinstance(part, np.ndarray)]
    return [*found, *(array for part in parts if dataclasses.is_dataclass(part) for array in arrays(part))]


@pytest.mark.parametrize("make", [episodes, solution, lambda: fake_samples(3).trajectory])
def test_results_travel_between_processes(make):
    result = make()
    again = pickle.loads(pickle.dumps(result))
    assert (type(again), repr(again)) == (type(result), repr(result))
    assert len(arrays(result)) >= 3
    for ours, theirs in zip(arrays(again), arrays(result), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="needs fork")
def test_a_database_is_read_in_other_processes(tmp_path):
    database = ocp_envs.Database.create(tmp_path / "d", DOUBLE_INTEGRATOR, [[1.0, 0.0], [2.0, 0.5]])
    again = pickle.loads(pickle.dumps(database))
    for read in (lambda: database.parameters, lambda: again.parameters, lambda: forked(lambda: database.parameters)):
        np.testing.assert_array_equal(read(), [[1.0, 0.0], [2.0, 0.5]])


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="needs fork")
def test_a_pool_serves_the_process_that_made_it_alone():
    def refused():
        with pytest.raises(RuntimeError, match="which made this pool; make a WorkerPool in each process"):
            pool.submit(abs, -1)
        pool.shutdown()
        return True

    with WorkerPool(1) as pool:
        assert pool.submit(abs, -1).result(LIMIT) == 1
        assert forked(refused)
        assert pool.submit(abs, -2).result(LIMIT) == 2


def test_a_problem_of_the_benchmark_is_itself_after_pickling_and_another_one_equal():
    assert pickle.loads(pickle.dumps(PENDULUM)) is PENDULUM
    other = pickle.loads(pickle.dumps(DOUBLE_INTEGRATOR))
    assert other.fingerprint == DOUBLE_INTEGRATOR.fingerprint
    assert not any(isinstance(value, BatchFunction) for value in vars(other).values())


@pytest.mark.parametrize("duplicate", [None, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_an_environment_in_use_refuses_other_threads_but_not_its_copies(duplicate):
    envs = moe_policy.environments(PENDULUM, 2)
    envs.reset(seed=0)
    other = envs if duplicate is None else duplicate(envs)

    def use(number):
        other.reset(seed=0)
        other.step(np.zeros((2, 1)))
        return moe_policy.rollout(other, moe_policy.Stabiliser(PENDULUM), [[3.1, 0.0]]).success.tolist()

    with envs.reserved():
        if duplicate is None:
            with pytest.raises(RuntimeError, match="another thread is using this environment; give each thread"):
                in_threads(use, 1)
        else:
            assert in_threads(use, 1) == [[True]]
        assert use(0) == [True]
    assert in_threads(use, 1) == [[True]]


def test_rollouts_of_two_threads_in_the_same_environments_do_not_mix():
    envs, policy = moe_policy.environments(PENDULUM, 2), moe_policy.Stabiliser(PENDULUM)
    started, wait = Event(), Event()

    class Slow(moe_policy.Stabiliser):
        def predict(self, *arguments, **keywords):
            started.set()
            wait.wait(LIMIT)
            return super().predict(*arguments, **keywords)

    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(moe_policy.rollout, envs, Slow(PENDULUM), [[3.1, 0.0]])
        started.wait(LIMIT)
        with pytest.raises(RuntimeError, match="another thread"):
            moe_policy.rollout(envs, policy, [[3.1, 0.0]])
        wait.set()
        assert running.result().success.all()
