"""The loop as it runs: compiled where numba is installed, else the same functions in plain Python."""

from __future__ import annotations

from cosim.engine import march as plain
from cosim.engine.compiled import Bind, bound, can_compile, compiled
from cosim.engine.implicit import step_once

#: How many steps are made between looks at Ctrl-C and the progress bar.
COMPILED_CHUNK, PYTHON_CHUNK = 20_000, 100

ENGINES = ("auto", "compiled", "python")


def loop(engine: str, *, adaptive: bool, implicit: bool) -> tuple[Bind, int]:
    """Return what binds the loop, and how many steps to make at once.

    Args:
        engine: `compiled`, `python`, or `auto`: the compiled one where numba is installed.
        adaptive: Steps that an error estimate chooses, not of one size.
        implicit: Steps that are repeated.
    """
    march = plain.march_adaptive if adaptive else plain.march
    if engine != "python" and can_compile():
        return compiled(march, {} if implicit else {"step_group": step_once}), COMPILED_CHUNK
    return bound(march), PYTHON_CHUNK
