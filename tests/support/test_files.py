"""The order in which files reach the disk, watched at the calls of the operating system."""

import os
from pathlib import Path

import pytest

from ocp_envs.support.files import make_folder, rename_folder, replacing


@pytest.fixture
def calls(monkeypatch):
    """What is synchronised and renamed, by name, in order."""
    noted, fsync, replace = [], os.fsync, os.replace

    def noted_fsync(descriptor):
        noted.append(("sync", Path(f"/proc/self/fd/{descriptor}").resolve().name))
        fsync(descriptor)

    def noted_replace(source, target):
        noted.append(("rename", Path(target).name))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", noted_fsync)
    monkeypatch.setattr(os, "replace", noted_replace)
    return noted


needs_proc = pytest.mark.skipif(not os.path.exists("/proc/self/fd"), reason="names descriptors with /proc")


@needs_proc
def test_the_content_is_on_the_disk_before_the_name_and_the_name_before_the_end(tmp_path, calls):
    with replacing(tmp_path / "file") as file:
        file.write(b"new")
    (first, temporary), *others = calls
    assert (first, temporary[:6]) == ("sync", ".file-")
    assert others == [("rename", "file"), ("sync", tmp_path.name)]
    assert (tmp_path / "file").read_bytes() == b"new"


@needs_proc
def test_a_folder_is_renamed_after_all_that_is_in_it_is_on_the_disk(tmp_path, calls):
    inner = tmp_path / "temporary" / "inner"
    inner.mkdir(parents=True)
    (inner / "file").write_text("content")
    rename_folder(tmp_path / "temporary", tmp_path / "whole")
    *before, last = calls
    assert before[-1] == ("rename", "whole")
    assert {name for _, name in before[:-1]} == {"temporary", "inner", "file"}
    assert last == ("sync", tmp_path.name)


@needs_proc
def test_folders_that_are_made_have_their_names_on_the_disk(tmp_path, calls):
    make_folder(tmp_path / "a" / "b")
    assert calls == [("sync", tmp_path.name), ("sync", "a")]
    make_folder(tmp_path / "a" / "b")
    assert len(calls) == 2


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    (tmp_path / "file").write_text("old")
    with pytest.raises(TypeError), replacing(tmp_path / "file") as file:
        file.write("a text")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("file", "old")]


def test_where_folders_cannot_be_synchronised_files_are_replaced_all_the_same(tmp_path, monkeypatch):
    opened = os.open

    def refuse(path, flags, *mode, **where):
        if Path(path).is_dir():
            raise PermissionError("a folder")
        return opened(path, flags, *mode, **where)

    monkeypatch.setattr(os, "open", refuse)
    with replacing(tmp_path / "file") as file:
        file.write(b"new")
    assert (tmp_path / "file").read_bytes() == b"new"
