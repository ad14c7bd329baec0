import json
from importlib.metadata import PackageNotFoundError

import numpy as np
import pytest

from ocp_envs.support.provenance import Provenance, provenance, write_json


def test_provenance_is_complete_and_can_be_written(tmp_path):
    record = provenance()
    assert record.versions["casadi"]
    assert record.cores >= 1
    write_json(tmp_path / "deep" / "record.json", record.to_json())
    assert json.loads((tmp_path / "deep" / "record.json").read_text()) == record.to_json()
    assert Provenance.from_json(json.loads((tmp_path / "deep" / "record.json").read_text())) == record


def test_versions_are_those_of_the_requirements_without_the_tools_of_development(monkeypatch):
    required = [
        "numpy>=1.26",
        "pillow>=10.0; extra == 'plots'",
        'pytest>=8.0; extra == "dev"',
        "nothing-like-it; extra == 'rl'",
    ]
    monkeypatch.setattr("importlib.metadata.requires", lambda name: required)
    assert list(provenance().versions) == ["ocp-moe", "numpy", "pillow"]


def test_a_package_that_is_not_installed_has_no_versions(monkeypatch):
    def requires(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.requires", requires)
    assert provenance().versions == {}


def test_another_object_is_no_provenance():
    with pytest.raises(ValueError, match=r"expected a provenance with the keys date, .*, got date"):
        Provenance.from_json({"date": "2026-01-01"})


def test_arrays_become_lists(tmp_path):
    write_json(tmp_path / "a.json", {"x": np.arange(3), "y": np.float64(0.5), "z": np.int8(2)})
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": [0, 1, 2], "y": 0.5, "z": 2}


def test_lists_of_numbers_stand_on_one_line(tmp_path):
    content = {"interval": [0.25, -1e-9, None], "deep": [[1, 2], [3]], "text": ["[ 1,\n 2 ]", "x"], "empty": []}
    write_json(tmp_path / "a.json", content)
    text = (tmp_path / "a.json").read_text()
    assert json.loads(text) == content
    assert '"interval": [0.25, -1e-09, null],\n' in text
    assert "    [1, 2],\n    [3]\n" in text


@pytest.mark.parametrize("value", [np.nan, float("inf"), object()])
def test_what_json_cannot_hold_leaves_the_old_file(tmp_path, value):
    path = tmp_path / "a.json"
    write_json(path, {"x": 1})
    with pytest.raises((TypeError, ValueError)):
        write_json(path, {"x": value})
    assert json.loads(path.read_text()) == {"x": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]
