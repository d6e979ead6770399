"""The master: one call for every algorithm."""

from __future__ import annotations

from collections.abc import Callable

from cosim.algorithm import Algorithm
from cosim.automatic import Automatic, run_automatic, run_default_at_step
from cosim.engine.loop import ENGINES
from cosim.given_step import run_at_step
from cosim.result import Result
from cosim.scenario import Scenario
from cosim.system import System
from eightpost.errors import InputError

#: A coupling step that suits race cars and their shocks (docs/coupling.md).
DEFAULT_STEP = 1e-3


def run(
    system: System,
    scenario: Scenario,
    *,
    algorithm: Algorithm | Automatic | None = None,
    step: float | None = None,
    compared: bool = True,
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
) -> Result:
    """Run a system and state its coupling error. Ctrl-C ends it between two steps with RunInterrupted, which holds what
    was computed.

    Args:
        system: Components and connections.
        scenario: Drive, duration, what to record.
        algorithm: Strategy object; by default (Automatic) the scheme is chosen to suit the components, and, where none
            is given, the step as well.
        step: Coupling step [s]; 1 ms for an algorithm that needs one. The last step is shortened to land on the stop
            time. For Adaptive: the first one to try.
        compared: Whether a run at a given step is compared with one at twice the step, or half of it, to state its
            coupling error. Without, the error is not stated.
        progress: Called now and then with the share done, 0 to 1; anew for every run that is made.
        engine: `auto`: the compiled loop where numba is installed; `python`: the same loop interpreted, the same bits.

    Returns:
        Recorded series in SI, status and statistics. A start that did not converge is in its status.

    Raises:
        WiringError: System, scenario and algorithm do not fit together.
        InputError: The coupling step does not fit.
        StepError: A component failed; the message names it, the time and what it said.
    """
    if engine not in ENGINES:
        raise InputError(f"engine is {', '.join(ENGINES)}, not {engine!r}")
    chosen = algorithm or Automatic()
    if isinstance(chosen, Automatic) and step is None:
        return run_automatic(system, scenario, chosen, engine, progress)
    size = DEFAULT_STEP if step is None else step
    if isinstance(chosen, Automatic):
        return run_default_at_step(system, scenario, chosen, size, engine=engine, progress=progress, compared=compared)
    return run_at_step(system, scenario, chosen, size, engine=engine, progress=progress, compared=compared)
