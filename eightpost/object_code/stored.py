"""Compilation by a program in a process of its own, because numba takes a second to load; the results are stored."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path

from eightpost.cache import keep, recall
from eightpost.object_code.native import description
from eightpost.workers.process import python_command, run

#: Folder of the cache, and the number of files in it.
_FOLDER, _KEPT = "loop", 40


def compiled_by(program: str, question: bytes, *, bare: str = "") -> bytes:
    """Return the object file that a module run as a program writes; numba does not optimise there.

    Numba would optimise every function with all functions that it calls, and again in each of its callers, which
    triples the time.

    Args:
        program: Module.
        question: Bytes that the program reads from its standard input.
        bare: Package whose own imports are skipped; see `python_command`.

    Raises:
        RuntimeError: numba or LLVM failed, with their message.
    """
    environment = os.environ | {"NUMBA_OPT": "0", "NUMBA_DISABLE_JIT": "0"}
    ran = run(python_command(program, bare=bare), environment=environment, question=question, tree=True)
    if ran.code != 0:
        raise RuntimeError(f"numba could not compile it: {ran.errors.decode(errors='replace').strip()}")
    return ran.output


def stored(key: str, make: Callable[[], bytes]) -> bytes:
    """Return the object file of a key from the cache; a missing or damaged one is made and stored."""
    content = recall(_FOLDER, key)
    if content is None:
        content = make()
        keep(_FOLDER, key, content, most=_KEPT)
    return content


def code_key(sources: Path, *what: str) -> str:
    """Return a digest of everything that machine code depends on, among it all Python files of a folder."""
    parts = (
        *what,
        _digest(*sorted(sources.glob("*.py")), Path(__file__)),
        version("numba"),
        version("llvmlite"),
        *description(),
    )
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@cache
def _digest(*files: Path) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
