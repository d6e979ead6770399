"""Compiled code in the cache runs only if nobody but this user and root can have written it."""

import os
import pickle
import sys

import pytest

from eightpost import cache

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other permissions")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    cache.keep("libraries", "key", b"code")
    return tmp_path / "cache" / "libraries"


def test_what_this_user_kept_is_recalled_and_private(folder):
    assert cache.recall("libraries", "key") == b"code"
    assert (folder.stat().st_mode & 0o777, (folder / "key").stat().st_mode & 0o777) == (0o700, 0o600)


def test_a_file_that_another_process_has_just_renamed_prevents_nothing(folder, caplog):
    (folder / "temporary").symlink_to("renamed")  # it is listed, but its state cannot be read
    cache.keep("libraries", "other", b"more")
    assert cache.recall("libraries", "other") == b"more"
    assert not caplog.records


@pytest.mark.parametrize(("name", "mode"), [("key", 0o620), ("key", 0o602), (".", 0o770), (".", 0o707)])
def test_a_file_or_folder_that_others_may_write_is_not_recalled_until_it_is_kept_again(folder, name, mode, caplog):
    (folder / name).chmod(mode)
    assert cache.recall("libraries", "key") is None
    assert "another user" in caplog.text
    cache.keep("libraries", "key", b"new")
    assert cache.recall("libraries", "key") == b"new"


@pytest.mark.parametrize(("owner", "is_recalled"), [(0, True), (12345, False)])
def test_the_owner_is_this_user_or_root(folder, monkeypatch, owner, is_recalled):
    real = os.stat_result

    class State:
        def __init__(self, found: real):
            self.st_uid, self.st_mode = owner, found.st_mode

    stat = type(folder).stat
    monkeypatch.setattr(type(folder), "stat", lambda self, **options: State(stat(self, **options)))
    assert cache._is_trusted(folder / "key") is is_recalled


@pytest.mark.parametrize(("mode", "content"), [(0o664, {"a": 1}), (0o666, None)])
def test_numbas_files_are_read_unless_everybody_may_write_them(tmp_path, mode, content):
    path = tmp_path / "loop.nbi"
    path.write_bytes(cache._sealed(pickle.dumps({"a": 1})))
    path.chmod(mode)
    assert cache._read(path) == content
