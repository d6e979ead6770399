"""Machine code of the loop: compiled once, stored on disk, compiled again if it is damaged, loaded without numba."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim.engine import machine_code
from cosim.engine.blocks import Block, described
from cosim.engine.machine_code import Request, object_file
from cosim.engine.march import compiled
from eightpost.cache import keep, recall
from eightpost.object_code import native
from eightpost.object_code import stored as storage
from eightpost.object_code.native import array_words
from eightpost.object_code.stored import code_key

#: Code with numba's calling convention: the result is stored where the first argument points.
CODE = """
target triple = "{triple}"
define i32 @double(i64* %result, i8** %raised, i64 %x) {{
  %y = shl i64 %x, 1
  store i64 %y, i64* %result
  %bad = icmp eq i64 %x, 0
  %status = select i1 %bad, i32 1, i32 0
  ret i32 %status
}}
"""


class Numbers(NamedTuple):
    values: NDArray[np.float64]
    count: int
    scale: float


class Outer(NamedTuple):
    inner: Numbers
    table: NDArray[np.uint32]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path))
    return tmp_path / "loop"


@pytest.fixture
def doubling() -> bytes:
    return native.optimised(CODE.format(triple=native.description()[0]), "double")


def test_the_description_of_a_block_lists_its_fields_and_their_types() -> None:
    block = Block(Outer(Numbers(np.zeros(2), 3, 0.5), np.zeros((2, 2), np.uint32)))
    assert described(block.kind) == "Outer(inner: Numbers(values: d1, count: int, scale: float), table: I2)"


def test_cached_code_is_recalled_and_damaged_code_is_not(cache: Path) -> None:
    keep("loop", "key", b"machine code")
    assert recall("loop", "key") == b"machine code"
    content = bytearray((cache / "key").read_bytes())
    content[40] ^= 1
    (cache / "key").write_bytes(content)
    assert recall("loop", "key") is None
    (cache / "key").write_bytes(b"")
    assert recall("loop", "key") is None


def test_the_least_recently_used_code_is_removed_first(cache: Path) -> None:
    for k, key in enumerate("abc"):
        keep("loop", key, key.encode())
        (cache / key).touch()
        os.utime(cache / key, (k, k))
    keep("loop", "d", b"d", most=2)
    assert sorted(path.name for path in cache.iterdir()) == ["c", "d"]


def test_nothing_is_cached_if_the_folder_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "file"))
    keep("loop", "key", b"machine code")
    assert recall("loop", "key") is None


def test_an_object_file_is_loaded_and_called(doubling: bytes) -> None:
    double = native.function_at(native.loaded_entries(doubling)[0], 1)
    assert double(21) == 42
    with pytest.raises(ArithmeticError, match="divided by zero"):
        double(0)


@pytest.mark.parametrize("damage", [False, True], ids=["kept", "damaged"])
def test_cached_code_is_reused_and_damaged_code_is_compiled_again(
    cache: Path, doubling: bytes, monkeypatch: pytest.MonkeyPatch, damage: bool
) -> None:
    made: list[object] = []

    def make(request: object) -> bytes:
        made.append(request)
        return doubling

    def function(numbers: Numbers) -> int:
        return numbers.count

    monkeypatch.setattr("cosim.engine.machine_code.object_file", make)
    bind, numbers = compiled(function, {}), Numbers(np.zeros(1), 3, 0.5)
    for _ in range(2):
        monkeypatch.setattr(machine_code, "_FUNCTIONS", {})
        assert bind(numbers)() != 0
        if damage:
            next(cache.iterdir()).write_bytes(b"not machine code")
    assert len(made) == (2 if damage else 1)


def test_the_cache_key_depends_on_sources_types_processor_and_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, content in (("first", "one = 1\n"), ("second", "one = 2\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "law.py").write_text(content)
    first, second = tmp_path / "first", tmp_path / "second"
    assert code_key(first, "march") == code_key(first, "march")
    keys = {
        code_key(first, "march", "Plan()"),
        code_key(first, "march", "Plan(a: d1)"),
        code_key(second, "march", "Plan()"),
    }
    monkeypatch.setattr(storage, "description", lambda: ("x86_64", "another", "+avx"))
    keys.add(code_key(first, "march", "Plan()"))
    monkeypatch.setattr(storage, "version", lambda _: "0.0")
    keys.add(code_key(first, "march", "Plan()"))
    assert len(keys) == 5


def test_an_array_is_as_many_words_as_numba_passes() -> None:
    words = array_words(table := np.zeros((3, 2)))
    assert words == (0, 0, 6, 8, table.__array_interface__["data"][0], 3, 2, 16, 8)


@pytest.mark.slow
def test_a_failed_compilation_is_reported() -> None:
    with pytest.raises(RuntimeError, match=r"(?s)could not be compiled; engine='python' needs.*TypingError"):
        object_file(Request(_no_integer, (), 1, {}))


def _no_integer(number: int) -> int:
    return number.no_such_field  # type: ignore[attr-defined,no-any-return]


@pytest.mark.nightly
def test_the_engine_loads_without_importing_numba() -> None:
    program = "import sys, cosim.engine.march, cosim.engine.machine_code; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True)
