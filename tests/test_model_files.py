from __future__ import annotations

import dataclasses
import json
import os
import shutil
from typing import get_args

import numpy as np
import pytest

import moe_policy
from moe_policy import model_files
from moe_policy.model_files import ModelFileError
from moe_policy.store import READERS
from ocp_envs.problems import UnknownProblemError
from ocp_envs.problems.pendulum import PENDULUM


@pytest.fixture
def saved(planners, tmp_path):
    planners["mixture"].save(tmp_path / "moe")
    return tmp_path / "moe"


@pytest.mark.parametrize("kind", ["single", "mixture", "soft", "nearest"])
def test_a_loaded_planner_plans_the_same(planners, kind, samples_of_three_modes, tmp_path):
    planner, p = planners[kind], samples_of_three_modes.parameters
    planner.save(tmp_path / "new" / "softmax-0.1")
    for path in ("softmax-0.1", "softmax-0.1.json", "softmax-0.1.safetensors"):
        loaded = moe_policy.load_file(tmp_path / "new" / path)
        assert (loaded.name, loaded.problem) == (planner.name, PENDULUM)
        atol = 1e-5 if kind == "nearest" else 0  # stored in float32
        np.testing.assert_allclose(loaded(p).flat(), planner(p).flat(), rtol=0, atol=atol)
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["softmax-0.1.json", "softmax-0.1.safetensors"]


def test_a_description_names_the_problem_and_where_it_was_made(saved):
    record = json.loads(saved.with_suffix(".json").read_text())
    assert (record["problem"], record["fingerprint"]) == (PENDULUM.id, PENDULUM.fingerprint)
    assert "versions" in record["provenance"]


def test_kinds_of_models_are_those_with_a_reader(tmp_path):
    assert set(READERS) == set(get_args(model_files.Kind))
    with pytest.raises(ValueError, match="unknown kind of model 'pickle'"):
        model_files.write_model(tmp_path / "model", "pickle", PENDULUM, {}, {})


@pytest.mark.parametrize("part", [".json", ".safetensors"])
def test_missing_and_truncated_files_are_named(saved, part):
    path = saved.with_suffix(part)
    content = path.read_bytes()
    for damaged in (content[: len(content) // 2], b"", b"\x80\x04}q\x00."):
        path.write_bytes(damaged)
        with pytest.raises(ModelFileError, match=path.name):
            moe_policy.load_file(saved)
    path.unlink()
    with pytest.raises(ModelFileError, match="missing"):
        moe_policy.load_file(saved)


def test_a_flipped_byte_is_found(saved):
    path = saved.with_suffix(".safetensors")
    content = bytearray(path.read_bytes())
    content[-5] ^= 1
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match="another save"):
        moe_policy.load_file(saved)


def test_halves_of_two_saves_are_refused(planners, saved, tmp_path):
    planners["single"].save(tmp_path / "snn")
    shutil.copy(tmp_path / "snn.safetensors", saved.with_suffix(".safetensors"))
    with pytest.raises(ModelFileError, match="another save"):
        moe_policy.load_file(saved)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"format": "other"}, "does not describe a model"),
        ({"version": 99}, "format version 99"),
        ({"kind": "pickle"}, "unknown kind"),
        ({"fingerprint": "0" * 16}, "train again"),
        ({"sizes": {"single": [2, 300, 75]}}, "do not fit together"),
        ({"mixing": {"softmax": -1}}, "do not fit together"),
        ({"sizes": None}, "do not fit together"),
    ],
)
def test_foreign_descriptions_are_refused(saved, change, match):
    path = saved.with_suffix(".json")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ModelFileError, match=match):
        moe_policy.load_file(saved)


def test_a_model_of_another_problem_is_refused(saved):
    heavier = PENDULUM.with_constants(mass=2.0)
    with pytest.raises(ModelFileError, match="train again"):
        moe_policy.load_file(saved, heavier)
    path = saved.with_suffix(".json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"problem": "Nothing-v0"}))
    with pytest.raises(UnknownProblemError):
        moe_policy.load_file(saved)


def test_an_interrupted_save_leaves_the_old_model(planners, saved, monkeypatch):
    before = {path: path.read_bytes() for path in saved.parent.iterdir()}
    monkeypatch.setattr(os, "replace", lambda *arguments: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        dataclasses.replace(planners["mixture"], name="other").save(saved)
    assert {path: path.read_bytes() for path in saved.parent.iterdir()} == before
