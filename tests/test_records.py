import json

import numpy as np
import pytest

from ocp_envs.records import provenance, write_json


def test_provenance_is_complete_and_can_be_written(tmp_path):
    record = provenance()
    assert record["versions"]["casadi"]
    assert record["cores"] >= 1
    write_json(tmp_path / "deep" / "record.json", record)
    assert json.loads((tmp_path / "deep" / "record.json").read_text()) == record


def test_arrays_become_lists(tmp_path):
    write_json(tmp_path / "a.json", {"x": np.arange(3), "y": np.float64(0.5), "z": np.int8(2)})
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": [0, 1, 2], "y": 0.5, "z": 2}


@pytest.mark.parametrize("value", [np.nan, float("inf"), object()])
def test_what_json_cannot_hold_leaves_the_old_file(tmp_path, value):
    path = tmp_path / "a.json"
    write_json(path, {"x": 1})
    with pytest.raises((TypeError, ValueError)):
        write_json(path, {"x": value})
    assert json.loads(path.read_text()) == {"x": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]
