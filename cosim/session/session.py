"""One run of a system with one algorithm."""

from __future__ import annotations

import time as clock
from collections.abc import Callable

from cosim.algorithm import Adaptive, Algorithm
from cosim.engine.compiled import can_compile
from cosim.engine.loop import loop
from cosim.engine.march import record
from cosim.engine.plan import IMPLICIT, STOPPED
from cosim.functions import Native
from cosim.interrupt import interrupts_deferred
from cosim.result import Result
from cosim.scenario import Scenario
from cosim.session.adaptive import march_adaptive
from cosim.session.fixed import march_fixed
from cosim.session.guard import CHUNK, guarded, undoing, watched
from cosim.session.outcome import Outcome
from cosim.session.repeats import check_repeat
from cosim.session.running import Ending, Marching, Running, begin, prepare
from cosim.session.setup import Setup
from cosim.system import System
from cosim.watch import calling_loop
from eightpost.errors import InputError


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during a run; `result` holds the result so far."""

    def __init__(self, result: Result) -> None:
        super().__init__("the run was interrupted")
        self.result = result


class Session:
    """A system, a scenario, an algorithm and a step, ready to run.

    Args:
        system: Components and connections.
        scenario: Drive, duration and recording.
        algorithm: Algorithm of the run.
        step: Coupling step [s]; for an adaptive run the first step to try.

    Raises:
        WiringError: System, scenario and algorithm do not fit together.
        InputError: The coupling step does not fit.
    """

    def __init__(self, system: System, scenario: Scenario, algorithm: Algorithm, step: float) -> None:
        self._setup = Setup.of(system, scenario, algorithm, step)

    def run(self, engine: str = "auto", progress: Callable[[float], None] | None = None) -> Result:
        """Begin, find the equilibrium start and step to the end. The components are finished in any case.

        Args:
            engine: `compiled`, `python`, or `auto`: compiled if numba is installed and a component is native.
            progress: Callback that receives the completed share, 0 to 1.

        Raises:
            InputError: The compiled loop is requested, but numba is not installed.
            StepError: A component failed, or the coupling diverged.
            RunInterrupted: Ctrl-C was pressed; the exception holds the result so far.
        """
        with watched(self._setup):
            return self._run(engine, progress or (lambda _: None))

    def _run(self, engine: str, progress: Callable[[float], None]) -> Result:
        began = clock.perf_counter()
        try:
            equilibrium = begin(self._setup)
            running = prepare(self._setup)
            ending = self._step(running, engine, undoing(self._setup, progress))
            seconds = (ending.began - began, clock.perf_counter() - ending.began)
            result = Outcome(self._setup, running, equilibrium, ending, seconds).result()
            if ending.why == STOPPED:
                raise RunInterrupted(result)
            check_repeat(self._setup, result.series)
            return result
        finally:
            for component in self._setup.system.components.values():
                component.finish()

    def _step(self, running: Running, engine: str, progress: Callable[[float], None]) -> Ending:
        try:
            with interrupts_deferred(running.stop), calling_loop():
                return self._march(running, engine, progress)
        finally:
            running.free_states(self._setup)

    def _march(self, running: Running, engine: str, progress: Callable[[float], None]) -> Ending:
        algorithm = self._setup.algorithm
        marching = self._marching(engine, progress)
        record(running.plan, running.memory, running.tape, 0.0)
        self._setup.discrete.record(1)
        ending = (
            march_adaptive(self._setup, running, marching, algorithm)
            if isinstance(algorithm, Adaptive)
            else march_fixed(self._setup, running, marching)
        )
        progress(1.0)
        return ending

    def _marching(self, engine: str, progress: Callable[[float], None]) -> Marching:
        """Return the requested loop; interpreted if every component is Python, where compiling gains nothing."""
        setup = self._setup
        native = any(isinstance(component, Native) for component in setup.system.components.values())
        mode = setup.algorithm.mode(setup.scenario.settling)
        bind, chunk = loop(
            engine if native or engine == "compiled" else "python",
            adaptive=isinstance(setup.algorithm, Adaptive),
            implicit=mode.kind == IMPLICIT,
        )
        if engine == "compiled" and not can_compile():
            raise InputError("the compiled loop needs numba, which is not installed: pip install numba, or engine auto")
        chunk = min(chunk, CHUNK) if guarded(setup) else chunk
        return Marching(bind, chunk, mode, progress)
