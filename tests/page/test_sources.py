"""The built page is that of its sources and of the shipped planners."""

import base64
import json
import re

import numpy as np
import pytest

import moe_policy
from moe_policy.experiments.page import bundle, program
from moe_policy.experiments.page.bundle import SOURCES
from moe_policy.experiments.page.contents import SHOWN, USUAL
from moe_policy.experiments.page.packing import Packing
from moe_policy.experiments.running import UsageError
from scripts.build_page import BUILT

CURE = "run python scripts/build_page.py --ship"


def _data(name):
    text = (BUILT / f"{name}.js").read_text(encoding="utf-8")
    return json.loads(re.fullmatch(rf'receive\("{name}", (.*)\);\n', text)[1])


def _array(data, place):
    block = base64.b64decode(data["block"])
    found = np.frombuffer(block, place["type"], place["size"], place["at"])
    if "units" not in place:
        return found
    units = _array(data, place["units"]).astype(np.float32)
    return (found.reshape(len(units), -1) * units[:, None]).ravel()


def test_the_html_is_that_of_the_sources():
    assert (BUILT / "index.html").read_text(encoding="utf-8") == bundle.page(SOURCES, USUAL), CURE


def test_the_page_loads_nothing_from_elsewhere():
    assert not re.findall(r"(?:src|href)=(?!\"data:)|https?://|@import|url\(", bundle.page(SOURCES, USUAL))


def test_all_files_together_are_small():
    assert {path.name for path in BUILT.iterdir()} == {"index.html", *(f"{name}.js" for name in USUAL)}
    assert sum(path.stat().st_size for path in BUILT.iterdir()) < 1.5e6


@pytest.mark.parametrize("name", USUAL)
def test_the_networks_are_the_shipped_ones(name):
    data = _data(name)
    for method, planner in SHOWN[name].planners.items():
        network = planner.network
        parts = [network.gate, *network.experts] if method == "mixture" else [network]
        described = data["planners"][method]
        layers = [*(described["gate"] or []), *(layer for expert in described["experts"] for layer in expert)]
        weights = [weight for part in parts for weight in part.weights]
        for layer, weight in zip(layers, weights, strict=True):
            np.testing.assert_array_equal(_array(data, layer["weights"]), weight.ravel(), err_msg=CURE)


def test_a_missing_compiler_is_named_with_its_cure(monkeypatch):
    monkeypatch.setattr(program.shutil, "which", lambda name: None)
    policy = moe_policy.TrackingPolicy("PendulumSwingup-v0", moe_policy.load("PendulumSwingup-v0", "snn"))
    with pytest.raises(UsageError, match="apt-get install clang lld"):
        program.program(policy, SOURCES / "c")


def test_arrays_begin_where_views_may_and_keep_their_numbers():
    packing, halves, singles = Packing(), np.array([0.5, -2.0, 0.25], np.float32), np.array([0.1], np.float32)
    places = [packing.place(halves), packing.place(singles), packing.place([1.0], "float64")]
    assert [place["type"] for place in places] == ["float16", "float32", "float64"]
    assert all(place["at"] % 8 == 0 for place in places)
    for place, values in zip(places, (halves, singles, [1.0])):
        np.testing.assert_array_equal(_array({"block": packing.text()}, place), values)


def test_weights_of_8_bits_differ_by_half_a_unit_at_most():
    weight = np.random.default_rng(0).normal(size=(5, 40)).astype(np.float32)
    weight[3] = 0
    packing = Packing(rounded=True)
    place = packing.weight(weight)
    found = _array({"block": packing.text()}, place).reshape(weight.shape)
    assert (np.abs(found - weight) <= np.abs(weight).max(axis=1, keepdims=True) / 253).all()


def test_modules_become_functions_in_the_order_of_their_imports(tmp_path):
    (tmp_path / "a.js").write_text('import { b } from "./b.js";\nb();\n')
    (tmp_path / "b.js").write_text("export function b() {}\nconst c = 1;\nexport { c };\n")
    script = bundle.script(tmp_path, "a.js")
    assert script.index("function b() {}") < script.index("const { b } = module_0;")
    assert "return { b, c };" in script
    assert "import" not in script
    assert "export" not in script
