"""Run at a given step, compared with runs at other steps to state its coupling error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from cosim.algorithm import Adaptive, Algorithm
from cosim.dense_runs import DenseRuns
from cosim.error_estimate import Comparison, compare, stated_error
from cosim.result import Result
from cosim.session import RunInterrupted, Session
from cosim.system import Scenario, System
from cosim.verdict import LARGEST_ERROR
from eightpost.errors import DivergedError

#: Ratio of tolerances of an adaptive run and the runs it is compared with; it corresponds to about half the step.
_TOLERANCE_RATIO = 8.0


def run_at_step(
    system: System,
    scenario: Scenario,
    algorithm: Algorithm,
    step: float,
    *,
    engine: str,
    progress: Callable[[float], None] | None,
    compared: bool,
) -> Result:
    """Run at a step and, if `compared`, state the coupling error by comparing with a run at twice the step.

    If that run is not possible or not comparable, or the stated error is too large, make another run at half the step.

    Raises:
        DivergedError: The coupling diverged.
        StepError: A component failed.
        RunInterrupted: Ctrl-C was pressed; the exception holds the result so far. If the run itself was complete, its
            result has no stated error.
    """
    Session(system, scenario, algorithm, step)  # raises errors before the recording is changed
    runs = DenseRuns(system, scenario, record_step=scenario.record_step or step, engine=engine, progress=progress)
    run = runs.run(algorithm, step)
    if not compared or run.partial:
        return runs.final(run)
    try:
        companions = _Companions(runs, system, scenario, algorithm, run)
        run = companions.with_stated_error()
    except RunInterrupted as interrupted:
        raise RunInterrupted(runs.final(run)) from interrupted
    return runs.final(run)


@dataclass(frozen=True)
class _Companions:
    """Runs that one run is compared with.

    Args:
        runs: Runs of the system at several steps.
        system: Components and connections.
        scenario: Drive, duration and recording.
        algorithm: Scheme of the run.
        run: Run whose error is to be stated.
    """

    runs: DenseRuns
    system: System
    scenario: Scenario
    algorithm: Algorithm
    run: Result

    def with_stated_error(self) -> Result:
        """Return the run with its stated error."""
        coarse = self._at(2.0) if self._can_double() else None
        if coarse is not None:
            first = self._compared(coarse, self.run)
            run = replace(self.run, stated_error=stated_error([first], self.system.coupled_with_held))
            if first.reliable and (run.coupling_error or 0.0) <= LARGEST_ERROR:
                return run
        fine = self._at(0.5)
        if fine is None:
            return replace(self.run, stated_error=dict.fromkeys(self.run.series.names, float("inf")))
        second = self._compared(self.run, fine)
        return replace(self.run, stated_error=self._of_coarser([second] if coarse is None else [first, second]))

    def _can_double(self) -> bool:
        """Return whether the run has at least two steps, and every component accepts the steps of twice the size."""
        if isinstance(self.algorithm, Adaptive):
            return True
        doubled = 2.0 * self.run.step
        rest = abs(round(self.scenario.stop / doubled) * doubled - self.scenario.stop)
        fits = all(c.capabilities.variable_step for c in self.system.components.values()) or rest < 1e-9 * doubled
        return doubled <= self.scenario.stop and fits

    def _at(self, ratio: float) -> Result | None:
        """Return the run at `ratio` times the step; None if it diverged."""
        try:
            if isinstance(self.algorithm, Adaptive):
                tolerance = _TOLERANCE_RATIO if ratio > 1.0 else 1.0 / _TOLERANCE_RATIO
                looser = replace(self.algorithm, relative=self.algorithm.relative * tolerance)
                found = self.runs.run(looser, self.run.step)
            else:
                found = self.runs.run(self.algorithm, ratio * self.run.step)
        except DivergedError:
            return None
        return None if found.partial else found

    def _compared(self, coarse: Result, fine: Result) -> Comparison:
        found = compare(coarse, fine)
        # The steps of adaptive runs have no common ratio: no order can be observed.
        return replace(found, local_order=None) if isinstance(self.algorithm, Adaptive) else found

    def _of_coarser(self, comparisons: list[Comparison]) -> dict[str, float]:
        """Return the error of the coarser of two runs [%] per channel: their difference plus the finer run's error."""
        finer, apart = stated_error(comparisons, self.system.coupled_with_held), comparisons[-1].difference
        return {name: apart[name] + finer[name] for name in apart}
