"""The loop as it runs: compiled where numba is installed, else the same functions in plain Python."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

from cosim.engine import march as plain
from cosim.engine.compiled import Bind, bound, compiled, shared

#: How many steps are made between looks at Ctrl-C and the progress bar.
COMPILED_CHUNK, PYTHON_CHUNK = 20_000, 100

ENGINES = ("auto", "compiled", "python")


@cache
def compiled_march() -> Bind | None:
    """Return march as machine code; None without numba."""
    inner, version = shared(plain.march), _version()

    def march(plan: Any, m: Any, tape: Any, grid: Any, mode: Any, first: int, last: int) -> int:
        return inner(plan, m, tape, grid, mode, first, last) if version != 0 else 0

    return compiled(march)


@cache
def compiled_march_adaptive() -> Bind | None:
    """Return march_adaptive as machine code; None without numba."""
    inner, version = shared(plain.march_adaptive), _version()

    def march_adaptive(
        plan: Any, m: Any, kept: Any, tape: Any, knots: Any, mode: Any, control: Any, progress: Any, last: int
    ) -> int:
        return inner(plan, m, kept, tape, knots, mode, control, progress, last) if version != 0 else 0

    return compiled(march_adaptive)


def can_compile() -> bool:
    """Return whether numba is installed."""
    return compiled_march() is not None


def loop(engine: str, *, adaptive: bool) -> tuple[Bind, int]:
    """Return what binds the loop, with steps of one size or chosen ones, and how many steps to make at once.

    `auto` is the compiled one where numba is installed.
    """
    found = None if engine == "python" else compiled_march_adaptive() if adaptive else compiled_march()
    if found is not None:
        return found, COMPILED_CHUNK
    return bound(plain.march_adaptive if adaptive else plain.march), PYTHON_CHUNK


def _version() -> int:
    """A number of all sources of the loop: numba keeps machine code by the one file that it finds a function in, and by
    the values that the function closes over."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return 1 + int.from_bytes(digest.digest()[:6], "big")
