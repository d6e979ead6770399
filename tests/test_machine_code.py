"""Machine code cached on disk: damaged files are rebuilt with a warning and never end a run."""

import importlib.util
import logging
import sys

import pytest
from numba import config, njit
from numba.core import caching

from eightpost.cache import kept


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Return a function that compiles a test function, or loads it from disk, like another process."""
    path = tmp_path / "kept_sine.py"
    path.write_text("import math\n\n\ndef sine(x):\n    return math.sin(x) + 1.0\n")
    monkeypatch.setattr(config, "CACHE_DIR", "")  # machine code is kept beside the file, whatever the environment says
    spec = importlib.util.spec_from_file_location("kept_sine", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "kept_sine", module)
    spec.loader.exec_module(module)
    return lambda: kept(njit(module.sine))


def cut(content):
    return content[: len(content) // 2]


def flipped(content):
    at = 2 * len(content) // 3
    return content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :]


@pytest.mark.repeated(2)
@pytest.mark.parametrize("damage", [lambda content: b"", cut, flipped], ids=["empty", "cut", "flipped"])
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_damaged_machine_code_is_compiled_again_with_a_warning(fresh, tmp_path, caplog, damage, suffix):
    assert fresh()(0.0) == 1.0
    (path,) = tmp_path.rglob(f"*.{suffix}")
    path.write_bytes(damage(path.read_bytes()))
    with caplog.at_level(logging.WARNING):
        assert fresh()(0.0) == 1.0
    assert f"cached machine code is damaged and is compiled again: {path}" in caplog.text
    last = fresh()
    assert last(0.0) == 1.0 and sum(last.stats.cache_hits.values()) == 1


def test_files_that_cannot_be_read_or_written_do_not_end_a_run(fresh, tmp_path, caplog):
    assert fresh()(0.0) == 1.0
    for path in [*tmp_path.rglob("*.nbi"), *tmp_path.rglob("*.nbc")]:
        path.unlink()
        path.mkdir()
    with caplog.at_level(logging.WARNING):
        assert fresh()(0.0) == 1.0
    assert "is compiled again" in caplog.text and "is compiled in every run" in caplog.text


def test_without_any_folder_it_is_compiled_in_every_run(fresh, monkeypatch, caplog):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    with caplog.at_level(logging.WARNING):
        assert fresh()(0.0) == 1.0
    assert "machine code cannot be cached" in caplog.text
