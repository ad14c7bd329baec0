import os
import stat
import warnings

import pytest

from ocp_envs.support import libraries
from ocp_envs.support.libraries import UntrustedLibrary, cache_folder, forget, trusted_library

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="POSIX permissions")
GOOD, EVIL = b"a library", b"planted"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("OCP_ENVS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


class Builder:
    count = 0

    def __call__(self):
        self.count += 1
        return GOOD


@pytest.fixture
def built(folder):
    return trusted_library("fatrop-1", Builder())


def rebuilt(match):
    """The library after it was built again, with a warning that has ``match``."""
    builder = Builder()
    with pytest.warns(UntrustedLibrary, match=match):
        path = trusted_library("fatrop-1", builder)
    assert builder.count == 1
    assert path.read_bytes() == GOOD
    return path


def test_a_library_is_built_once_and_private(folder, built):
    builder = Builder()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert trusted_library("fatrop-1", builder) == built
    assert builder.count == 0
    assert folder.stat().st_mode & 0o077 == 0
    assert all(not path.stat().st_mode & 0o022 for path in folder.iterdir() if path.suffix != ".lock")


def test_a_folder_that_only_its_owner_could_write_is_narrowed_and_keeps_its_libraries(folder, built):
    folder.chmod(0o755)
    assert cache_folder() == folder
    assert folder.stat().st_mode & 0o077 == 0
    assert built.exists()


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o1777])
def test_libraries_in_a_folder_that_others_could_write_are_removed(mode, folder, built):
    built.write_bytes(EVIL)
    folder.chmod(mode)
    (folder / "notes.txt").write_text("stays")
    rebuilt("others could write")
    assert folder.stat().st_mode & 0o077 == 0
    assert (folder / "notes.txt").exists()


@pytest.mark.parametrize("content", [b"", GOOD[:4], GOOD + EVIL, EVIL], ids=["empty", "cut", "longer", "other"])
def test_a_damaged_library_is_built_again_before_anything_loads_it(content, built):
    built.write_bytes(content)
    rebuilt("is damaged")


def test_a_library_of_another_name_is_not_taken(folder, built):
    other = trusted_library("fatrop-2", lambda: EVIL)
    os.replace(other, built)
    os.replace(folder / "fatrop-2.so.sha256", folder / "fatrop-1.so.sha256")
    rebuilt("is damaged")


@pytest.mark.parametrize("name", ["fatrop-1.so", "fatrop-1.so.sha256"])
def test_a_link_is_replaced_and_what_it_leads_to_stays(name, folder, built, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    os.replace(folder / name, elsewhere)
    (folder / name).symlink_to(elsewhere)
    content = elsewhere.read_bytes()
    rebuilt("no regular file")
    assert not (folder / name).is_symlink()
    assert elsewhere.read_bytes() == content


@pytest.mark.parametrize("name", ["fatrop-1.so", "fatrop-1.so.sha256"])
@pytest.mark.parametrize("mode", [0o666, 0o664])
def test_a_file_that_others_could_write_is_replaced(name, mode, folder, built):
    (folder / name).chmod(mode)
    rebuilt("could be written by others")


@pytest.mark.parametrize("name", ["fatrop-1.so", "fatrop-1.so.sha256"])
def test_a_file_of_another_user_is_replaced(name, folder, built, monkeypatch):
    lstat = libraries.Path.lstat

    def planted(path):
        status = lstat(path)
        if path.name != name:
            return status
        return os.stat_result([status.st_uid + 1 if i == stat.ST_UID else value for i, value in enumerate(status[:10])])

    with monkeypatch.context() as patch:
        patch.setattr(libraries.Path, "lstat", planted)
        assert libraries._distrust(built) == "belongs to another user"


def test_a_library_without_a_record_is_built_again(folder, built):
    (folder / "fatrop-1.so.sha256").unlink()
    builder = Builder()
    trusted_library("fatrop-1", builder)
    assert builder.count == 1


def test_a_folder_with_the_name_of_a_library_is_named(folder, built):
    forget(built)
    built.mkdir()
    with pytest.raises(OSError, match=r"fatrop-1\.so is a folder where a file is expected; remove it"):
        trusted_library("fatrop-1", Builder())


@pytest.mark.parametrize("link", [False, True], ids=["folder", "link"])
def test_a_folder_of_another_user_is_refused(link, tmp_path, folder, monkeypatch):
    target = tmp_path / "target"
    target.mkdir()
    if link:
        folder.symlink_to(target)
    else:
        folder.mkdir()
    uid = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: uid + 1)
    with pytest.raises(OSError, match="belongs to another user; set OCP_ENVS_CACHE"):
        cache_folder()


def test_a_folder_that_everybody_can_rename_is_refused(tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    monkeypatch.setenv("OCP_ENVS_CACHE", str(shared / "cache"))
    with pytest.raises(OSError, match="everybody can rename folders in"):
        cache_folder()
    shared.chmod(0o1777)
    assert cache_folder() == shared / "cache"
