"""Selection of the loop: compiled, or the same functions in plain Python."""

from __future__ import annotations

from cosim.engine import march as plain
from cosim.engine.compiled import Bind, bound, compiled
from cosim.engine.implicit import step_once

#: Number of steps between checks for Ctrl-C and updates of the progress bar.
COMPILED_CHUNK, PYTHON_CHUNK = 20_000, 100

ENGINES = ("auto", "compiled", "python")


def loop(engine: str, *, adaptive: bool, implicit: bool) -> tuple[Bind, int]:
    """Return the function that binds the loop, and the number of steps per call.

    Args:
        engine: `python`, else the compiled loop.
        adaptive: Whether an error estimate controls the steps.
        implicit: Whether steps are repeated.
    """
    march = plain.march_adaptive if adaptive else plain.march
    if engine == "python":
        return bound(march), PYTHON_CHUNK
    return compiled(march, {} if implicit else {"step_group": step_once}), COMPILED_CHUNK
