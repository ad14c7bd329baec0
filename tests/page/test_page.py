"""The page in a real browser: what it shows, how it is used, and its numbers against Python's."""

import atexit
import shutil
import tempfile
import threading
from functools import lru_cache, partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.experiments.page.contents import SHOWN, USUAL
from scripts.build_page import BUILT, build
from tests.page.browser import CHROMIUM, chromium

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium")
CLOSE = {"rtol": 1e-5, "atol": 1e-5}
METHODS = ("snn", "mixture")
DESKTOP, PHONE = (1280, 900), (390, 844)


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@lru_cache
def folder_of(name):
    """The folder of the page that shows the problem ``name``: the committed one, or one that is built for the test."""
    if name in USUAL:
        return BUILT
    if shutil.which("clang") is None or shutil.which("wasm-ld") is None:
        pytest.skip("needs clang and lld: apt-get install clang lld")
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder)
    build([name], folder)
    return folder


def opened(browser, name, size=DESKTOP, scheme="light"):
    """The page with the problem ``name``, standing still, in a window of a ``size``."""
    if browser.shows == (name, size, scheme):  # loading takes longer than most tests
        browser.run("shown.set(shown.view.initial)")
        return browser
    browser.shows, folder = (name, size, scheme), folder_of(name)
    browser.problems.clear()
    browser.size(*size, phone=size == PHONE)
    browser.prefer(prefers_color_scheme=scheme, prefers_reduced_motion="reduce")
    browser.open("about:blank")
    browser.open(f"{(folder / 'index.html').as_uri()}#{name}")
    browser.until("document.querySelector('tbody tr')")
    browser.run(f"stageOf('{name}').then((stage) => void (window.shown = stage))")
    return browser


@pytest.fixture(params=[*USUAL, pytest.param("sphere", marks=pytest.mark.slow)])
def name(request):
    return request.param


@pytest.fixture(params=["pendulum", *(pytest.param(name, marks=pytest.mark.slow) for name in ("vehicle", "sphere"))])
def any_name(request):
    """A problem, for what hardly depends on it."""
    return request.param


def instances(name, count):
    return ocp_envs.sample(SHOWN[name].env, seed=11, n=count)


def part(name):
    return f"""shown.part("{name}")"""


class Exact:
    """A network planner in double precision, as the page and exported C calculate; Python does in single precision."""

    def __init__(self, planner):
        self.problem, self._function = planner.problem, planner.to_casadi()

    def __call__(self, p):
        return self.problem.unflatten(np.array(self._function.map(len(p))(np.asarray(p).T)[0]).T)


@lru_cache
def planners(name):
    return SHOWN[name].planners


# -- numbers -----------------------------------------------------------------------------------------------------------


def test_plans_and_choices_are_those_of_python(browser, name):
    opened(browser, name)
    p = instances(name, 40)
    for method, planner in planners(name).items():
        found = browser.run(f"{p.tolist()}.map((p) => Array.from(shown.model.plan('{method}', p).flat))")
        np.testing.assert_allclose(found, Exact(planner)(p).flat(), rtol=1e-9, atol=1e-9)
        scale = planner.outputs.std  # what rounding in the network is relative to
        np.testing.assert_allclose(found / scale, planner(p).flat() / scale, rtol=5e-5, atol=5e-5)
    chosen = browser.run(f"{p.tolist()}.map((p) => shown.model.plan('mixture', p).expert)")
    np.testing.assert_array_equal(chosen, planners(name)["mixture"].gate(p)[0])


def test_tracked_episodes_are_those_of_python(browser, name):
    opened(browser, name)
    p = instances(name, 12)
    for method, planner in planners(name).items():
        policy = moe_policy.TrackingPolicy(planner.problem, Exact(planner))
        episodes = moe_policy.rollout(moe_policy.environments(planner.problem, len(p)), policy, p, record=True)
        found = browser.run(
            f"{p.tolist()}.map((p) => shown.model.methods(p).find(({{ id }}) => id === '{method}').verdict)"
        )
        last = np.rint(episodes.evaluation_time / policy.dt).astype(int)
        final = episodes.states[np.arange(len(p)), last]
        np.testing.assert_allclose([each["finalState"] for each in found], final, **CLOSE)
        np.testing.assert_allclose([each["cost"] for each in found], episodes.cost, **CLOSE)
        np.testing.assert_allclose([each["error"] for each in found], episodes.plan_end_error, **CLOSE)
        assert [each["success"] for each in found] == episodes.success.tolist()
        if planner.problem.constrained:
            deepest = [max(0.0, -each["clearance"]) for each in found]
            np.testing.assert_allclose(deepest, episodes.violation, **CLOSE)


def test_the_nearest_optimum_is_the_nearest(browser, any_name):
    opened(browser, any_name)
    p, box = instances(any_name, 10), moe_policy.load(SHOWN[any_name].env, "nearest").problem.parameters
    stored = browser.run("Array.from({ length: shown.model.nearest.count }, (_, i) => shown.model.nearest.at(i))")
    distances = np.linalg.norm((p[:, None] - np.array(stored)[None]) / box.width, axis=2)
    rows = browser.run(f"{p.tolist()}.map((p) => shown.model.nearest.row(p))")
    np.testing.assert_allclose(distances[np.arange(len(p)), rows], distances.min(axis=1))


# -- use ---------------------------------------------------------------------------------------------------------------


def test_the_page_loads_without_errors_and_says_its_verdict(browser, name):
    opened(browser, name)
    assert browser.run(f"{part('verdicts')}.rows.length") == 3
    browser.until(f"{part('words')}.textContent.includes('goal')")
    assert browser.run("document.getElementById('status').textContent") == ""
    assert browser.problems == []


def test_a_static_host_serves_the_page(browser):
    handler = partial(SimpleHTTPRequestHandler, directory=BUILT)
    handler.log_message = lambda *_: None
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser.problems.clear()
        browser.shows = None
        browser.open(f"http://127.0.0.1:{server.server_port}/index.html")
        browser.until("document.querySelector('tbody tr')")
        server.shutdown()
    assert browser.problems == []


def test_the_reader_moves_on_while_the_initial_condition_crosses_a_discontinuity(browser, any_name):
    opened(browser, any_name)
    browser.prefer(prefers_reduced_motion="no-preference")
    browser.run(f"{part('sweep')}.click()")
    browser.until(f"shown.p[0] !== {browser.run('shown.view.initial[0]')}")
    browser.run(f"{part('sliders')}.querySelector('input').focus()")
    browser.press("ArrowLeft")
    stopped = browser.run("shown.p")
    browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    browser.shows = None
    assert browser.run("shown.p") == stopped


def test_hidden_methods_are_not_drawn(browser):
    opened(browser, "pendulum")
    button = f"{part('legend')}.children[0]"
    browser.run(f"{button}.click()")
    assert browser.run(f"{button}.getAttribute('aria-pressed')") == "false"
    assert browser.run("shown.hidden.has('snn')")
    browser.run(f"{button}.click()")
    assert not browser.run("shown.hidden.size")


def _at(browser, points):
    """Pixels of the window at which the map shows parameters."""
    browser.run(f"{part('map')}.scrollIntoView({{ block: 'center' }})")
    box = browser.run(f"{part('map')}.getBoundingClientRect().toJSON()")
    pixels = browser.run(f"{[list(point) for point in points]}.map((p) => shown.map.pixel(p))")
    return [(box["left"] + x, box["top"] + y) for x, y in pixels]


FINAL_STATES = "Object.fromEntries(shown.methods.map(({ id, plan }) => [id, plan.states.at(-1)]))"


@pytest.mark.parametrize(
    ("name", "track", "index", "ends_at"),
    [
        ("pendulum", [(theta, -0.55) for theta in np.linspace(2.4, 3.0, 60).tolist()], 0, (-1, 1)),
        ("vehicle", [(x, 8.5, -0.8, 1.0) for x in np.linspace(-1.5, 3.5, 60).tolist()], 2, (-2, 0)),
    ],
)
def test_across_a_discontinuity_the_plan_of_the_mixture_flips_and_that_of_the_single_network_slides(
    browser, name, track, index, ends_at
):
    opened(browser, name)
    browser.run(f"shown.set({list(track[0])})")
    ends, (first, last) = {method: [] for method in METHODS}, ends_at
    for _ in browser.drag(_at(browser, track)):
        finals = browser.run(FINAL_STATES)
        for method, found in ends.items():
            found.append(finals[method][index] / np.pi)
    mixture, single = np.array(ends["mixture"]), np.array(ends["snn"])
    flipped = mixture > (first + last) / 2
    np.testing.assert_allclose(mixture, np.where(flipped, last, first), atol=0.15)  # at one or the other, never between
    assert not flipped[0]
    assert np.count_nonzero(np.diff(flipped)) == 1
    between = (first + 0.2 < single) & (single < last - 0.2)
    assert between.sum() > 5
    assert np.abs(np.diff(single)).max() < 0.5


def test_arrow_keys_and_sliders_move_the_initial_condition(browser, any_name):
    opened(browser, any_name)
    before = browser.run("shown.p")
    browser.run(f"{part('map')}.focus()")
    browser.press("ArrowRight")
    moved = browser.run("shown.p")
    assert moved[browser.run("shown.view.map.x")] > before[browser.run("shown.view.map.x")]
    browser.run(f"{part('sliders')}.querySelector('input').focus()")
    browser.press("ArrowLeft")
    assert browser.run("shown.p[0]") < moved[0]
    assert browser.run("document.activeElement.getAttribute('aria-valuetext')")


def test_every_control_has_a_name(browser, any_name):
    opened(browser, any_name)
    nodes = browser.call("Accessibility.getFullAXTree")["nodes"]
    roles = {"button", "slider", "tab", "application", "image", "columnheader", "rowheader"}
    shown = [node for node in nodes if not node["ignored"] and node["role"]["value"] in roles]
    assert len(shown) > 10
    assert [node["role"]["value"] for node in shown if not node["name"]["value"]] == []


# -- screens -----------------------------------------------------------------------------------------------------------


def test_a_finger_drags_on_a_phone_where_nothing_scrolls_sideways(browser, name):
    opened(browser, name, PHONE)
    assert browser.run("document.documentElement.scrollWidth") == PHONE[0]
    cut = "[...document.querySelectorAll('.scroll')].filter((each) => each.scrollWidth > each.clientWidth).length"
    assert browser.run(cut) == 0
    p = browser.run("shown.p")
    here, there = _at(browser, [p, browser.run("shown.view.sweep.to")])
    browser.touch([here, there])
    assert browser.run("shown.p") != p
    assert browser.problems == []


def test_the_theme_is_that_of_the_system_until_the_reader_chooses(browser):
    colors = []
    for scheme in ("light", "dark"):
        opened(browser, "pendulum", scheme=scheme)
        colors.append(browser.run("getComputedStyle(document.body).backgroundColor"))
    browser.shows = None
    browser.run("document.getElementById('theme').click()")
    colors.append(browser.run("getComputedStyle(document.body).backgroundColor"))
    browser.run("localStorage.clear()")
    assert colors[0] == colors[2] != colors[1]


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_screenshots_show_the_whole_page(browser, name, size, scheme, tmp_path):
    from PIL import Image

    opened(browser, name, size, scheme)
    browser.screenshot(tmp_path / "page.png")
    picture = np.asarray(Image.open(tmp_path / "page.png").convert("L"))
    assert picture.shape[1] == size[0] * (2 if size == PHONE else 1)
    assert (picture.mean() < 100) == (scheme == "dark")
