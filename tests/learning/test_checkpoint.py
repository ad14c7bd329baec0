from __future__ import annotations

import pickle

import pytest
import torch

from moe_policy.learning.checkpoint import Checkpoint, CheckpointError, identify


def test_the_last_state_is_read_again(tmp_path):
    path = tmp_path / "part.pt"
    checkpoint = Checkpoint(path, "mine")
    assert checkpoint.read() is None
    for epoch in (1, 2):
        checkpoint.write({"epoch": epoch, "best": [torch.arange(3)], "seconds": 0.5})
    state = Checkpoint(path, "mine").read()
    assert (state["epoch"], state["seconds"]) == (2, 0.5)
    assert torch.equal(state["best"][0], torch.arange(3))
    assert [file.name for file in tmp_path.iterdir()] == ["part.pt"]


def test_the_state_of_another_training_is_refused(tmp_path):
    Checkpoint(tmp_path / "part.pt", "mine").write({"epoch": 1})
    with pytest.raises(CheckpointError, match="other data, settings or seed"):
        Checkpoint(tmp_path / "part.pt", "yours").read()


@pytest.mark.parametrize(
    "content", [b"", b"no checkpoint", pickle.dumps({"identity": "mine"}, 2), pickle.dumps(print, 2)]
)
def test_what_is_no_checkpoint_is_refused(tmp_path, content):
    path = tmp_path / "part.pt"
    path.write_bytes(content)
    with pytest.raises(CheckpointError, match=r"part\.pt is damaged, or not a checkpoint; delete it"):
        Checkpoint(path, "mine").read()


def test_half_a_checkpoint_is_refused(tmp_path):
    path = tmp_path / "part.pt"
    Checkpoint(path, "mine").write({"best": [torch.zeros(1000)]})
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(CheckpointError, match="damaged"):
        Checkpoint(path, "mine").read()


def test_a_flipped_bit_is_found(tmp_path):
    path = tmp_path / "part.pt"
    Checkpoint(path, "mine").write({"best": [torch.arange(100.0)], "epoch": 3})
    content, refused = path.read_bytes(), 0
    for place in range(0, len(content), 7):
        path.write_bytes(content[:place] + bytes([content[place] ^ 16]) + content[place + 1 :])
        try:
            state = Checkpoint(path, "mine").read()
        except CheckpointError:
            refused += 1
        else:  # in what no reader looks at, such as a date
            assert torch.equal(state["best"][0], torch.arange(100.0))
            assert state["epoch"] == 3
    assert refused > 100


def test_a_state_is_due_after_its_interval(tmp_path):
    assert not Checkpoint(tmp_path / "part.pt", "mine").due
    assert Checkpoint(tmp_path / "part.pt", "mine", every=0.0).due


def test_everything_that_is_named_identifies():
    tensor = torch.arange(6.0).reshape(2, 3)
    known = identify("gate", 64, tensors=[tensor])
    assert known == identify("gate", 64, tensors=[tensor.clone()])
    others = [identify("gate", 65, tensors=[tensor]), identify("gate", 64, tensors=[tensor + 1]), identify("gate", 64)]
    assert known not in others
    assert identify(tensors=[tensor.T]) == identify(tensors=[tensor.T.contiguous()])
