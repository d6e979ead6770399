"""Runs at given steps that are compared to state the coupling error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from cosim.results.error_estimate import Comparison, compare, stated_error
from cosim.results.result import Result
from cosim.results.rules import LARGEST_ERROR
from cosim.session.recorder import recorded_names
from cosim.session.session import RunInterrupted, Session
from cosim.systems.algorithm import Adaptive, Algorithm
from cosim.systems.scenario import Scenario
from cosim.systems.system import System
from eightpost.errors import DivergedError
from eightpost.progress import Progress
from eightpost.signals import TimeSeries

# ---- Runs for comparison, recorded at every coupling step -----------------------------------------------------------

#: Largest number of values of a run that is recorded at every step [1]: 160 MB.
_MOST_VALUES = 20_000_000


class DenseRuns:
    """Runs of one system at several steps.

    Args:
        system: Components and connections.
        scenario: Scenario with the channels that the final result has to record.
        record_step: Time between samples of the final result [s].
        engine: Engine of the loop; see `cosim.run`.
        progress: Callback that receives the completed and the total number of coupling steps of all runs.
        planned: Number of coupling steps of the runs that are certain to be made.
    """

    def __init__(
        self,
        system: System,
        scenario: Scenario,
        *,
        record_step: float,
        engine: str,
        progress: Progress | None,
        planned: float = 0.0,
    ) -> None:
        self._system, self._scenario, self._record_step = system, scenario, record_step
        self._engine, self._progress = engine, progress
        self._made, self._planned = 0.0, planned
        self._names = recorded_names(system, scenario)
        self._all_names = tuple(dict.fromkeys((*self._names, *sorted(system.decisive))))
        self._steps = 0
        self._seconds = self._stepping_seconds = 0.0

    def run(self, scheme: Algorithm, step: float) -> Result:
        """Make one run.

        Raises:
            DivergedError: The coupling diverged.
            StepError: A component failed.
            RunInterrupted: Ctrl-C was pressed; the exception holds the result so far.
        """
        every = self._record_step if isinstance(scheme, Adaptive) else self._dense_step(step)
        scenario = replace(self._scenario, record=self._all_names, record_step=every)
        try:
            result = Session(self._system, scenario, scheme, step).run(self._engine, self._progress_of(step))
        except RunInterrupted as interrupted:
            raise RunInterrupted(self.final(interrupted.result)) from interrupted
        self._steps += result.steps
        self._seconds += result.seconds
        self._stepping_seconds += result.stepping_seconds
        return result

    def _progress_of(self, step: float) -> Progress | None:
        """Return the callback of a run at a step, which is added to those before it."""
        if (progress := self._progress) is None:
            return None
        before, own = self._made, self._scenario.stop / step
        self._made += own
        self._planned = total = max(self._planned, self._made)
        return lambda done, of: progress(before + own * done / of, total)

    def _dense_step(self, step: float) -> float:
        """Return the step or, if that gives too many values, a multiple of it that divides the record step [s]."""
        multiple = max(1, ceil(len(self._all_names) * self._scenario.stop / step / _MOST_VALUES))
        parts = round(self._record_step / step)
        if parts >= 1 and abs(parts * step - self._record_step) < 1e-9 * self._record_step:
            multiple = next(m for m in range(min(multiple, parts), parts + 1) if parts % m == 0)
        return multiple * step

    def final(self, run: Result) -> Result:
        """Return a run with the samples and channels that the scenario selects, and with the cost of all runs."""
        return replace(
            run,
            series=self._thinned(run.series),
            held_direct=tuple(name for name in run.held_direct if name in self._names),
            seconds=self._seconds,
            stepping_seconds=self._stepping_seconds,
            steps_of_all_runs=self._steps,
        )

    def _thinned(self, series: TimeSeries) -> TimeSeries:
        stride = round(self._record_step / float(series.time[1] - series.time[0])) if len(series) > 2 else 1
        kept = np.unique(np.append(np.arange(0, len(series), stride), len(series) - 1))
        rows = [series.names.index(name) for name in self._names]
        values = np.ascontiguousarray(series.values[rows][:, kept])
        return TimeSeries(series.time[kept], values, self._names, tuple(series.units[row] for row in rows))


# ---- A run at a given step, compared with runs at other steps -------------------------------------------------------

#: Ratio of tolerances of an adaptive run and the runs it is compared with; it corresponds to about half the step.
_TOLERANCE_RATIO = 8.0


def run_at_step(
    system: System,
    scenario: Scenario,
    algorithm: Algorithm,
    step: float,
    *,
    engine: str,
    progress: Progress | None,
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
    planned = (1.5 if compared else 1.0) * scenario.stop / step
    every = scenario.record_step or step
    runs = DenseRuns(system, scenario, record_step=every, engine=engine, progress=progress, planned=planned)
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
    """Runs that one run is compared with."""

    runs: DenseRuns  #: Runs of the system at several steps.
    system: System  #: Components and connections.
    scenario: Scenario  #: Drive, duration and recording.
    algorithm: Algorithm  #: Scheme of the run.
    run: Result  #: Run whose error is to be stated.

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
