from __future__ import annotations

import dataclasses
import json
import os
import shutil
from typing import get_args

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy import model_files, store
from moe_policy.model_files import ModelFileError
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.store import READERS
from ocp_envs.problems import UnknownProblemError
from ocp_envs.problems.pendulum import PENDULUM
from tests.learners import random_actor


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


@pytest.mark.parametrize(("kind", "part"), [("single", 0.75), ("mixture", 0.75), ("nearest", 0.5)])
def test_a_rounded_planner_takes_less_space_and_comes_back_as_it_was(planners, kind, part, tmp_path):
    rounded = planners[kind].rounded()
    planners[kind].save(tmp_path / "whole")
    rounded.save(tmp_path / "rounded")
    loaded, p = store.load_file(tmp_path / "rounded"), ocp_envs.sample(PENDULUM, seed=3, n=20)
    np.testing.assert_array_equal(loaded(p).flat(), rounded(p).flat())
    np.testing.assert_allclose(loaded(p).flat(), planners[kind](p).flat(), rtol=0, atol=0.02)
    sizes = [(tmp_path / f"{name}.safetensors").stat().st_size for name in ("rounded", "whole")]
    assert sizes[0] < part * sizes[1]


def test_numbers_that_half_precision_would_change_are_kept(tmp_path, planners):
    planners["single"].save(tmp_path / "model")
    tensors = model_files.read_model(tmp_path / "model").tensors
    assert tensors["network.weights.0"].dtype == np.float32
    assert tensors["inputs.mean"].dtype == np.float64


def test_a_description_names_the_problem_and_where_it_was_made(saved):
    record = json.loads(saved.with_suffix(".json").read_text())
    assert (record["problem"], record["fingerprint"]) == (PENDULUM.id, PENDULUM.fingerprint)
    assert "versions" in record["provenance"]


def test_kinds_of_models_are_those_with_a_reader(tmp_path):
    assert set(READERS) == set(get_args(model_files.Kind)) == set(model_files.CONTENT)
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


# -- edited descriptions -----------------------------------------------------------------------------------------------


def places(value, path=()):
    """Where in a JSON value its numbers, texts and empty parts are."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    yield from ((*path, key) for key, _ in inner)
    for key, each in inner:
        yield from places(each, (*path, key))


def edited(record, path, change):
    """A copy of the JSON object ``record`` whose part at ``path`` is changed."""
    copy = json.loads(json.dumps(record))
    part = copy
    for key in path[:-1]:
        part = part[key]
    change(part, path[-1])
    return copy


def removed(part, key):
    del part[key]


def replaced(part, key):
    part[key] = "other" if part[key] != "other" else None


def mistyped(part, key):
    if isinstance(part, dict):
        part[f"{key}s"] = part.pop(key)
    else:
        part.insert(key, part[key])


@pytest.fixture(params=["mixture", "single", "soft", "nearest", "policy"])
def any_model(request, planners, tmp_path):
    """A model of each kind, saved."""
    policy = LearnedPolicy(PENDULUM, random_actor((3, 8, 1), "tanh"), period=0.04, details={"settings": {"steps": 1}})
    model = policy if request.param == "policy" else planners[request.param]
    model.save(tmp_path / "any")
    return tmp_path / "any.json"


@pytest.mark.parametrize("change", [removed, replaced, mistyped])
def test_any_edit_of_a_description_is_refused(any_model, change):
    record = json.loads(any_model.read_text())
    count = 0
    for path in places(record):
        any_model.write_text(json.dumps(edited(record, path, change)))
        with pytest.raises(ModelFileError):
            moe_policy.load_file(any_model)
        count += 1
    assert count > 20
    any_model.write_text(json.dumps(record))  # another layout of the same content
    moe_policy.load_file(any_model)


def older(path, **changes):
    """Turn the description at ``path`` into one of format version 1, which has no checksum, with other values."""
    record = json.loads(path.read_text())
    del record["checksum"]
    path.write_text(json.dumps(record | {"version": 1} | changes))


def test_files_saved_before_the_checksum_was_introduced_are_read(any_model):
    before = moe_policy.load_file(any_model)
    older(any_model)
    assert type(moe_policy.load_file(any_model)) is type(before)


def test_a_description_without_its_checksum_is_no_older_one(any_model):
    record = json.loads(any_model.read_text())
    any_model.write_text(json.dumps(record | {"version": 1}))
    with pytest.raises(ModelFileError, match=r"unknown keys \['checksum'\]"):
        moe_policy.load_file(any_model)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"format": "other"}, "does not describe a model"),
        ({"version": 99}, "format version 99, expected 1 or 2"),
        ({"version": []}, "format version"),
        ({"kind": "pickle"}, "unknown kind"),
        ({"kind": []}, "unknown kind"),
        ({"kind": "rl"}, r"unknown keys \['mixing', 'name'\], and \['activation'"),
        ({"fingerprint": "0" * 16}, "train again"),
        ({"sizes": {"single": [2, 300, 75]}}, "do not fit together"),
        ({"sizes": {"single": [2, 10**12, 75]}}, "do not fit together"),
        ({"sizes": {"single": [2, 10**400, 75]}}, "do not fit together"),
        ({"sizes": {"simple": [2, 300, 75]}}, "expected sizes of 'single', or of 'gate' and 'experts'"),
        ({"mixing": {"softmax": -1}}, "do not fit together"),
        ({"mixing": {"softmax": 10**400}}, "do not fit together"),
        ({"mixing": {"sofmax": 1.0}}, "expected the mixing 'argmax' .* or 'softmax'"),
        ({"mixing": []}, "do not fit together"),
        ({"sizes": None}, "do not fit together"),
        ({"period": 0.3}, r"unknown keys \['period'\]"),
    ],
)
def test_older_descriptions_that_make_no_model_are_refused(saved, change, match):
    path = saved.with_suffix(".json")
    older(path, **change)
    with pytest.raises(ModelFileError, match=match):
        moe_policy.load_file(saved)


@pytest.mark.parametrize("change", [{"period": 10**400}, {"period": "x"}, {"sizes": [3, 10**9, 1]}, {"squash": []}])
def test_older_policies_that_make_no_policy_are_refused(tmp_path, change):
    LearnedPolicy(PENDULUM, random_actor((3, 8, 1), "tanh"), period=0.04).save(tmp_path / "sac")
    older(tmp_path / "sac.json", **change)
    with pytest.raises(ModelFileError, match="do not fit together"):
        moe_policy.load_file(tmp_path / "sac")


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a": 1' + "0" * 5000 + "}", "[]", "null", "\ufeff{}"])
def test_texts_that_are_no_description_are_refused(saved, text):
    saved.with_suffix(".json").write_text(text)
    with pytest.raises(ModelFileError, match=r"moe\.json"):
        moe_policy.load_file(saved)


def test_descriptions_hold_what_their_kind_holds(tmp_path):
    with pytest.raises(ValueError, match=r"expected a description with \['name'\], got \['nmae'\]"):
        model_files.write_model(tmp_path / "model", "nearest", PENDULUM, {}, {"nmae": "nearest"})


every_shipped_file = pytest.mark.parametrize(
    "path", sorted(store.SHIPPED.glob("*/*.json")), ids=lambda path: f"{path.parent.name}/{path.stem}"
)


@every_shipped_file
def test_shipped_networks_are_in_half_precision_and_trajectories_are_packed(path):
    tensors = model_files.read_model(path).tensors
    assert "trajectories" not in tensors
    assert {array.dtype for name, array in tensors.items() if name.startswith("network.")} <= {np.dtype(np.float16)}


@every_shipped_file
def test_shipped_descriptions_carry_their_checksum(path):
    assert json.loads(path.read_text())["version"] == 2
    model_files.read_model(path)


def test_a_model_of_another_problem_is_refused(saved):
    heavier = PENDULUM.with_constants(mass=2.0)
    with pytest.raises(ModelFileError, match="train again"):
        moe_policy.load_file(saved, heavier)
    older(saved.with_suffix(".json"), problem="Nothing-v0")
    with pytest.raises(UnknownProblemError):
        moe_policy.load_file(saved)


def test_an_interrupted_save_leaves_the_old_model(planners, saved, monkeypatch):
    before = {path: path.read_bytes() for path in saved.parent.iterdir()}
    monkeypatch.setattr(os, "replace", lambda *arguments: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        dataclasses.replace(planners["mixture"], name="other").save(saved)
    assert {path: path.read_bytes() for path in saved.parent.iterdir()} == before
