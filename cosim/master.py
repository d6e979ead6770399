"""The master: one call for every algorithm."""

from __future__ import annotations

from collections.abc import Callable

from cosim.algorithm import Algorithm, GaussSeidel
from cosim.automatic import Automatic, run_automatic
from cosim.engine.loop import ENGINES
from cosim.result import Result
from cosim.scenario import Scenario
from cosim.session import Session
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
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
) -> Result:
    """Run a system. Ctrl-C ends it between two steps with RunInterrupted, which holds what was computed.

    Args:
        system: Components and connections.
        scenario: Drive, duration, what to record.
        algorithm: A strategy object; by default the step is chosen and the coupling error stated (Automatic), or, where
            a step is given, GaussSeidel() at that step.
        step: Coupling step [s], 1 ms for an algorithm that needs one; the last one is shortened to land on the stop
            time. For Adaptive: the first one to try.
        progress: Called now and then with the share done, 0 to 1; anew for every run that the default makes.
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
    chosen = algorithm or (Automatic() if step is None else GaussSeidel())
    if isinstance(chosen, Automatic):
        if step is not None:
            raise InputError("the default chooses the coupling step: give a step, or the default, not both")
        return run_automatic(system, scenario, chosen, engine, progress)
    return Session(system, scenario, chosen, DEFAULT_STEP if step is None else step).run(engine, progress)
