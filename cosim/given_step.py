"""A run at a given step, and companions at other steps that tell how large its coupling error is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from cosim.algorithm import Adaptive, Algorithm
from cosim.dense_runs import DenseRuns
from cosim.error_estimate import Comparison, compare, stated_error
from cosim.result import Result
from cosim.scenario import Scenario
from cosim.session import RunInterrupted, Session
from cosim.system import System
from cosim.verdict import LARGEST_ERROR
from eightpost.errors import DivergedError

#: An adaptive run is compared with runs at this many times its tolerance, or this share of it: about half the step.
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
    """Run at a step, and where `compared`, state the coupling error by comparing with a run at twice the step.

    Where that run cannot be had or compared, or the error so stated is too large, another run is made at half the step.

    Raises:
        DivergedError: The coupling diverged.
        StepError: A component failed.
        RunInterrupted: Ctrl-C; it holds the result so far, of a companion the result without a stated error.
    """
    Session(system, scenario, algorithm, step)  # refuses what does not fit before the recording is changed
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
        runs: Maker of the runs.
        system: Components and connections.
        scenario: Drive, duration and recording.
        algorithm: Scheme of the run.
        run: The run that is to be judged.
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
        """Whether the run has two steps, and every component takes the steps that twice the step leads to."""
        if isinstance(self.algorithm, Adaptive):
            return True
        doubled = 2.0 * self.run.step
        rest = abs(round(self.scenario.stop / doubled) * doubled - self.scenario.stop)
        fits = all(c.capabilities.variable_step for c in self.system.components.values()) or rest < 1e-9 * doubled
        return doubled <= self.scenario.stop and fits

    def _at(self, ratio: float) -> Result | None:
        """Return the run at `ratio` times the step; None where it diverged."""
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
        """Return per channel the error of the coarser of two runs [%]: their difference and the finer one's error."""
        finer, apart = stated_error(comparisons, self.system.coupled_with_held), comparisons[-1].difference
        return {name: apart[name] + finer[name] for name in apart}
