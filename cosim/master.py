"""The master: runs a coupled system with the default, at a given step or with a given algorithm."""

from __future__ import annotations

from collections.abc import Callable

from cosim.algorithm import Algorithm
from cosim.automatic import Automatic, run_automatic, run_default_at_step
from cosim.engine.loop import ENGINES
from cosim.given_step import run_at_step
from cosim.result import Result
from cosim.system import DEFAULT_STEP, Scenario, System
from eightpost.errors import InputError


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
    """Run a system and state its coupling error. Ctrl-C ends the run between two steps with RunInterrupted, which holds
    the result so far.

    Args:
        system: Components and connections.
        scenario: Drive, duration and variables to record.
        algorithm: Algorithm object; by default (Automatic) a scheme that suits the components is chosen and, if no step
            is given, the step as well.
        step: Coupling step [s]; 1 ms by default for algorithms other than Automatic. The last step is shortened to end
            at the stop time. For Adaptive: the first step to try.
        compared: Whether a run at a given step is compared with one at twice the step, or half of it, to state its
            coupling error. If false, the error is not stated.
        progress: Callback that receives the completed share, 0 to 1; it starts from 0 again for every run.
        engine: `auto`: the compiled loop if numba is installed; `python`: the same loop interpreted, equal results.

    Returns:
        Recorded series in SI, status and statistics. The status reports a start that did not converge.

    Raises:
        WiringError: System, scenario and algorithm do not fit together.
        InputError: The coupling step does not fit.
        StepError: A component failed; the message gives its name, the time and its last messages.
    """
    if engine not in ENGINES:
        raise InputError(f"engine must be one of {', '.join(ENGINES)}, not {engine!r}")
    chosen = algorithm or Automatic()
    if isinstance(chosen, Automatic) and step is None:
        return run_automatic(system, scenario, chosen, engine, progress)
    size = DEFAULT_STEP if step is None else step
    if isinstance(chosen, Automatic):
        return run_default_at_step(system, scenario, chosen, size, engine=engine, progress=progress, compared=compared)
    return run_at_step(system, scenario, chosen, size, engine=engine, progress=progress, compared=compared)
