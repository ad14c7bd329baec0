"""Pictures in the plane and in space, drawn without a screen."""

from __future__ import annotations

import dataclasses
import sys
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")


import ocp_envs  # noqa: E402
from ocp_envs.envs.env import Env  # noqa: E402
from ocp_envs.picture import Ball, Face, Line, Picture  # noqa: E402
from ocp_envs.problems.pendulum import PENDULUM  # noqa: E402
from ocp_envs.problems.quadcopter import CONSTANTS, DRAWN_SCALE, QUADCOPTER, QUADCOPTER_OBSTACLE, SYSTEM, attitude  # noqa: E402
from ocp_envs.problems.vehicle import VEHICLE  # noqa: E402
from ocp_envs.render.scene import Scene  # noqa: E402


def in_space():
    """The quadcopter with a picture of its own: a cross, and the obstacle."""

    def body(state, context):
        position = state[:3]
        arms = [Line(np.array([position - arm, position + arm])) for arm in 0.5 * np.eye(3)[:2]]
        return [*arms, Ball(context[:3], context[3], alpha=0.4), Ball(position, 0.1)]

    picture = Picture(((-8.0, 8.0),) * 3, body, lambda states: states[:, :3])
    return dataclasses.replace(QUADCOPTER_OBSTACLE, picture=picture)


def brown_centre(frame):
    """Mean pixel (column, row) of the pendulum's colour #8c4a2f."""
    rows, columns = np.nonzero((np.abs(frame.astype(int) - [0x8C, 0x4A, 0x2F]) < 12).all(axis=2))
    return columns.mean(), rows.mean()


def test_the_pendulum_is_drawn_where_it_is():
    env = gym.make("PendulumSwingup-v0", render_mode="rgb_array")
    centres = []
    for theta in (0.0, np.pi / 2, np.pi, 3 * np.pi / 2):
        env.reset(options={"parameters": [theta, 0.0]})
        frame = env.render()
        assert frame.shape == (480, 480, 3)
        assert frame.dtype == np.uint8
        centres.append(brown_centre(frame))
    (below_x, below), (right, level), (above_x, above), (left, also_level) = centres
    assert left < below_x - 50 < right - 100
    assert above < level - 50 < below - 100
    assert below_x == pytest.approx(above_x, abs=2)
    assert level == pytest.approx(also_level, abs=2)


def test_space_is_drawn_in_space():
    env = Env(in_space(), render_mode="rgb_array")
    frames = []
    for x in (-6.0, 6.0):
        env.reset(options={"parameters": [x, 3.0, 2.0, 1.0, -2.0, 0.0, 2.0]})
        env.step(np.full(4, 2.0))
        frames.append(env.render())
    assert frames[0].shape == (480, 480, 3)
    assert (frames[0] != frames[1]).any(axis=2).sum() > 100


def state_at(position, angles=(0.0, 0.0, 0.0)):
    return np.concatenate([position, np.zeros(3), angles, np.zeros(3)])


def flight(start, end=(0.0, 0.0, 0.0), knots=20):
    """States along a straight line, not a solution."""
    return np.array([state_at(p) for p in np.linspace(start, end, knots)])


def picture_of(problem, states, context=(), plan=None):
    scene = Scene(problem)
    scene.draw(states, np.asarray(context, dtype=float), 0.0, 0.0, plan)
    return scene, scene.pixels()


def pixel(scene, point):
    """Row and column at which a point in space is drawn."""
    x, y, _, w = scene.stage.axes.get_proj() @ [*point, 1.0]
    column, row = scene.stage.axes.transData.transform((x / w, y / w))
    return round(480 - row), round(column)


def changed(a, b):
    return int((a != b).any(axis=2).sum())


def red_centre(frame):
    """Mean pixel (row, column) of the translucent rotor, and its number of pixels."""
    red = (frame[..., 0] > 150) & (frame[..., 1] < 130) & (frame[..., 2] < 150)
    rows, columns = np.nonzero(red & (frame[..., 2].astype(int) > frame[..., 1] + 10))
    return rows.mean(), columns.mean(), len(rows)


def test_the_quadcopter_is_drawn_where_it_is():
    rotor = DRAWN_SCALE * CONSTANTS["arm"] * np.array([1.0, 0.0, 0.15])
    for position in ([-8.0, 6.0, -5.0], [0.0, 0.0, 8.0], [9.0, -9.0, 0.0]):
        scene, frame = picture_of(QUADCOPTER, state_at(position)[None])
        assert frame.shape == (480, 480, 3)
        *centre, count = red_centre(frame)
        assert count > 30
        assert centre == pytest.approx(pixel(scene, position + rotor), abs=3)
        ink = frame[pixel(scene, position)]
        assert ink.max() < 90  # the hub


def test_the_quadcopter_tilts():
    level = red_centre_of(0.0)
    assert red_centre_of(0.9)[0] > level[0] + 5  # a positive pitch lowers the front
    assert red_centre_of(-0.9)[0] < level[0] - 5


def red_centre_of(pitch):
    return red_centre(picture_of(QUADCOPTER, state_at([4.0, -4.0, 0.0], (0.0, pitch, 0.0))[None])[1])


def test_the_drawn_attitude_is_that_of_the_dynamics():
    generator = np.random.default_rng(0)
    x = np.concatenate([np.zeros(6), generator.uniform(-1, 1, 6)])
    u = generator.uniform(1, 3, 4)
    constants = SimpleNamespace(**CONSTANTS)
    rates = np.array([float(r) for r in SYSTEM.dynamics(x, u, constants)])
    rotation = attitude(x)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    thrust = rotation[:, 2] * u.sum() / CONSTANTS["mass"] - [0, 0, CONSTANTS["gravity"]]
    np.testing.assert_allclose(thrust, rates[3:6], atol=1e-12)
    h = 1e-6
    change = (attitude(x + h * rates) - attitude(x - h * rates)) / (2 * h)
    p, q, r = x[9:]
    np.testing.assert_allclose(change, rotation @ [[0, -r, q], [r, 0, -p], [-q, p, 0]], atol=1e-8)


def test_the_drawn_rotors_turn_the_vehicle_as_the_dynamics_say():
    constants = SimpleNamespace(**CONSTANTS)
    shapes = QUADCOPTER.picture.body(np.zeros(12), np.zeros(0))
    hubs = [line.points[1] / DRAWN_SCALE for line in shapes if isinstance(line, Line)]
    assert len(hubs) == 4
    u = np.array([1.0, 1.3, 0.7, 2.0])
    moment = sum(np.cross(hub, [0, 0, thrust]) for hub, thrust in zip(hubs, u))
    rates = [float(r) for r in SYSTEM.dynamics(np.zeros(12), u, constants)]
    expected = [rates[9] * CONSTANTS["inertia_x"], rates[10] * CONSTANTS["inertia_y"]]
    np.testing.assert_allclose(moment[:2], expected, atol=1e-12)


def test_path_plan_and_obstacle_are_drawn():
    start, far = [-8.0, -6.0, 5.0], [5.0, 5.0, 5.0, 3.0]
    states = flight(start)[:8]
    _, bare = picture_of(QUADCOPTER_OBSTACLE, states[-1:], far)
    _, flown = picture_of(QUADCOPTER_OBSTACLE, states, far)
    _, planned = picture_of(QUADCOPTER_OBSTACLE, states, far, flight(start))
    _, other = picture_of(QUADCOPTER_OBSTACLE, states, [*far[:3], 4.0])
    _, failed = picture_of(QUADCOPTER_OBSTACLE, states, far, np.full((20, 12), np.nan))
    assert changed(bare, flown) > 100
    assert changed(flown, planned) > 100
    assert changed(flown, other) > 1000
    legend = np.s_[:100, :130]
    assert changed(failed[legend], planned[legend]) == 0  # a plan that failed: an empty one
    failed[legend] = flown[legend]
    assert changed(failed, flown) == 0


def test_a_path_behind_the_sphere_is_dimmed_and_one_before_it_is_not():
    sphere = np.array([2.0, 2.0, 2.0, 3.0])
    scene, _ = picture_of(QUADCOPTER_OBSTACLE, state_at([-9.0, 9.0, 9.0])[None], sphere)
    ray = sphere[:3] - scene.stage.viewer
    ray /= np.linalg.norm(ray)
    across = np.cross(ray, [0, 0, 1.0]) * np.linspace(-2, 2, 40)[:, None]
    trail = {}
    for name, depth in (("before", -3.5), ("behind", 3.5)):
        middle = sphere[:3] + depth * ray
        states = np.array([state_at(p) for p in [*(middle + across), [-9.0, 9.0, 9.0]]])
        states[-2] = np.nan  # lift the pen on the way to the vehicle
        scene, frame = picture_of(QUADCOPTER_OBSTACLE, states, sphere)
        trail[name] = frame[pixel(scene, middle)].astype(int)
    blue = np.array([0x3B, 0x6E, 0xA5])
    assert np.abs(trail["before"] - blue).max() < 45
    assert trail["behind"][0] > trail["before"][0] + 30  # the sphere's red over it
    assert trail["behind"][2] < trail["before"][2]


def test_one_scene_draws_as_a_fresh_one_does():
    scene = Scene(QUADCOPTER_OBSTACLE)
    cases = [
        (flight([-8.0, 6.0, -5.0])[:9], [5.0, 5.0, 5.0, 3.0]),
        (flight([8.0, 8.0, 8.0])[:12], [4.0, 4.0, 4.0, 3.0]),
        (flight([8.0, 8.0, 8.0])[:2], [-4.0, 4.0, 4.0, 1.0]),
    ]
    for states, context in cases:
        scene.draw(states, np.array(context), 0.0, 0.0)
        np.testing.assert_array_equal(scene.pixels(), picture_of(QUADCOPTER_OBSTACLE, states, context)[1])


def test_a_plan_is_drawn_in_the_plane_too():
    states = np.zeros((20, 4))
    states[:, 0], states[:, 1] = np.linspace(-9, 0, 20), np.linspace(5, 0, 20)
    _, bare = picture_of(VEHICLE, states[:1])
    _, planned = picture_of(VEHICLE, states[:1], plan=states)
    assert changed(bare, planned) > 100


@pytest.mark.parametrize("size", [2, 3])
def test_faces_are_filled(size):
    def body(state, context):
        corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
        return [Face(corners[:, :size], "#ff0000")] if state[1] > 0 else []

    path = lambda states: np.zeros((len(states), size))  # noqa: E731
    problem = dataclasses.replace(PENDULUM, picture=Picture(((-2.0, 2.0),) * size, body, path))
    counts = []
    scene = Scene(problem)
    for omega in (1.0, -1.0, 2.0):
        scene.draw(np.array([[0.0, omega]]), np.zeros(0), 0.0, 0.0)
        counts.append(int((scene.pixels() == [255, 0, 0]).all(axis=2).sum()))
    assert counts[0] == counts[2] > 500
    assert counts[1] == 0


def test_pictures_and_shapes_of_wrong_dimensions_say_so():
    nothing = lambda state, context: []  # noqa: E731
    for limits in (((0.0, 1.0),), ((0.0, 1.0),) * 4, ((0.0, 1.0), (1.0, 1.0)), ((0.0, 1.0), (0.0, np.inf)), ((0.0,),)):
        with pytest.raises(ValueError, match=r"expected limits|limits: expected"):
            Picture(limits, nothing, lambda states: states[:, :2])
    with pytest.raises(ValueError, match=r"Line: expected points .* got \(3,\)"):
        Line(np.zeros(3))
    with pytest.raises(ValueError, match=r"Face: expected points .* got \(2, 3\)"):
        Face(np.zeros((2, 3)))
    for center, radius in ((np.zeros(4), 1.0), (np.zeros(3), 0.0)):
        with pytest.raises(ValueError, match="Ball: expected a center"):
            Ball(center, radius)
    states, context = np.zeros((5, 12)), np.zeros(0)
    flat = Picture(((-1.0, 1.0),) * 3, nothing, lambda states: states[:, :2])
    with pytest.raises(ValueError, match=r"path has to return \(5, 3\).*got \(5, 2\)"):
        flat.trace(states)
    mixed = Picture(((-1.0, 1.0),) * 3, lambda s, c: [Line(np.zeros((2, 2)))], lambda states: states[:, :3])
    with pytest.raises(ValueError, match="3 limits, got a Line of 2"):
        mixed.shapes(states[0], context)


def test_artists_follow_shapes_that_come_and_go():
    def body(state, context):
        many = [Line(np.array([[0.0, 0.0], [1.0, 1.0]])), Ball(np.zeros(2), 0.2)]
        return many if state[1] > 0 else many[::-1][:1]

    problem = dataclasses.replace(PENDULUM, picture=Picture(((-2.0, 2.0),) * 2, body, lambda x: x))
    scene = Scene(problem)
    pictures = []
    for omega in (1.0, -1.0, 1.0):
        scene.draw(np.array([[0.0, omega]]), np.zeros(0), 0.0, 0.0)
        pictures.append(scene.pixels())
    np.testing.assert_array_equal(pictures[0], pictures[2])
    assert (pictures[0] != pictures[1]).any()


def test_what_cannot_be_drawn_says_so(monkeypatch):
    with pytest.raises(ValueError, match="has no picture"):
        Env(dataclasses.replace(PENDULUM, picture=None), render_mode="rgb_array")
    with pytest.raises(ValueError, match="plot_trajectory"):
        Scene(dataclasses.replace(PENDULUM, picture=None))
    with pytest.raises(ValueError, match="reset"):
        Env(PENDULUM, render_mode="rgb_array").render()
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    env = Env(PENDULUM, render_mode="rgb_array")
    env.reset(seed=0)
    with pytest.raises(ImportError, match=r"pip install 'ocp-moe\[plots\]'"):
        env.render()


def test_importing_the_package_does_not_import_matplotlib():
    import subprocess

    code = "import sys, ocp_envs; assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
    assert callable(ocp_envs.plot_trajectory)


@pytest.mark.parametrize("name", ocp_envs.names())
@pytest.mark.parametrize(
    "title", [None, "", "W" * 150, "park and stop, facing along the y axis; " * 3, "go on and on " * 60]
)
def test_title_and_caption_fit_into_the_picture(name, title):
    problem = ocp_envs.load(name)
    scene = Scene(problem if title is None else dataclasses.replace(problem, title=title))
    boxes = [text.get_window_extent() for text in scene.figure.texts]
    for text, box in zip(scene.figure.texts, boxes):
        assert 0 <= box.x0 <= box.x1 <= 480, text.get_text()
        assert 0 <= box.y0 <= box.y1 <= 480, text.get_text()
    if problem.picture.caption:
        assert not boxes[0].overlaps(boxes[-1])
