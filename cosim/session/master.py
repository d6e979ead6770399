"""The master: runs a coupled system by default, at a given step or with a given algorithm, and repeats a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from cosim.engine.loop import ENGINES
from cosim.results.error_estimate import difference
from cosim.results.result import Result
from cosim.session.automatic import Automatic, Refinement, default_scheme, run_default_at_step
from cosim.session.given_step import run_at_step
from cosim.session.session import Session
from cosim.systems.algorithm import Adaptive, Algorithm
from cosim.systems.scenario import Scenario
from cosim.systems.system import DEFAULT_STEP, System
from eightpost.errors import InputError, WiringError, check_number
from eightpost.progress import Progress


def run(
    system: System,
    scenario: Scenario,
    *,
    parameters: Mapping[str, float | bool | str] | None = None,
    algorithm: Algorithm | Automatic | None = None,
    step: float | None = None,
    compared: bool = True,
    progress: Progress | None = None,
    engine: str = "auto",
) -> Result:
    """Run a system and state its coupling error. Ctrl-C ends the run between two steps with RunInterrupted, which holds
    the result so far.

    Args:
        system: Components and connections.
        scenario: Drive, duration and variables to record.
        parameters: Values of parameters for this run only, by `component.parameter`; see `System.with_parameters`. The
            components are not loaded again, and the system does not change.
        algorithm: Algorithm object; by default (Automatic) a scheme that suits the components is chosen and, if no step
            is given, the step as well.
        step: Coupling step [s]; 1 ms by default for algorithms other than Automatic. The last step is shortened to end
            at the stop time. For Adaptive: the first step to try.
        compared: Whether a run at a given step is compared with one at twice the step, or half of it, to state its
            coupling error. If false, the error is not stated.
        progress: Callback that receives the number of completed coupling steps and the total number, about ten times
            per second; the total grows if the coupling error requires another run.
        engine: `auto`: the compiled loop if a component has C functions; `python`: the same loop interpreted, equal
            results.

    Returns:
        Recorded series in SI, status and statistics. The status reports a start that did not converge.

    Raises:
        WiringError: System, scenario and algorithm do not fit together.
        InputError: An argument is of the wrong kind, or the coupling step does not fit.
        StepError: A component failed; the message gives its name, the time and its last messages.
    """
    if engine not in ENGINES:
        raise InputError(f"engine must be one of {', '.join(ENGINES)}, not {engine!r}")
    check_number("step", step, "s")
    if not system.components:
        raise WiringError("the system has no component, so there is nothing to run; give FMUs to System.load")
    if parameters is not None and not isinstance(parameters, Mapping):
        raise InputError(f"parameters is {parameters!r}; give values by name: {{'lf.compression_scale': 1.2}}")
    if progress is not None and not callable(progress):
        raise InputError(f"progress is {progress!r}; give a function of two numbers, the completed and the total")
    chosen = algorithm or Automatic()
    if isinstance(chosen, type) or not hasattr(chosen, "name"):
        raise InputError(f"algorithm is {chosen!r}; give an algorithm object such as cosim.GaussSeidel()")
    system = system.with_parameters(parameters or {})
    if isinstance(chosen, Automatic) and step is None:
        return Refinement(system, scenario, chosen, engine, progress).result()
    size = DEFAULT_STEP if step is None else step
    if isinstance(chosen, Automatic):
        return run_default_at_step(system, scenario, chosen, size, engine=engine, progress=progress, compared=compared)
    return run_at_step(system, scenario, chosen, size, engine=engine, progress=progress, compared=compared)


# ---- Repetition with a finer step, to show how far a run's numbers depend on the coupling step ----------------------

#: An adaptive run is repeated at this share of its tolerance: about half the step.
_FINER_TOLERANCE = 1.0 / 8.0


@dataclass(frozen=True)
class Verification:
    """A run and its repetition."""

    finer: Result  #: Result of the repetition.
    #: Root mean square of the difference after settling per channel, in percent of the finer run's standard deviation.
    difference: Mapping[str, float]


def verify(
    system: System,
    scenario: Scenario,
    algorithm: Algorithm | Automatic,
    result: Result,
    *,
    progress: Progress | None = None,
    engine: str = "auto",
) -> Verification:
    """Repeat a run with the same scheme at half its coupling step; an adaptive run at an eighth of its tolerance.

    Args:
        system: System of the run.
        scenario: Scenario of the run.
        algorithm: Algorithm of the run; for the default, the scheme that it chose is repeated.
        result: Result of the run.
        progress: Callback that receives the completed share and 1.
        engine: Engine of the loop; see `run`.

    Raises:
        StepError: A component failed.
    """
    scheme = default_scheme(result.scheme) if isinstance(algorithm, Automatic) else algorithm
    if isinstance(scheme, Adaptive):
        scheme = replace(scheme, relative=_FINER_TOLERANCE * scheme.relative)
    recorded = scenario.record_step or (None if isinstance(scheme, Adaptive) else result.step)
    finer = Session(system, replace(scenario, record_step=recorded), scheme, 0.5 * result.step).run(engine, progress)
    return Verification(finer, difference(result.settled(), finer.settled()))
