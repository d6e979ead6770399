"""Runs of one system for comparison, recorded at every coupling step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import ceil

import numpy as np

from cosim.algorithm import Adaptive, Algorithm
from cosim.recorder import recorded_names
from cosim.result import Result
from cosim.session import RunInterrupted, Session
from cosim.system import Scenario, System
from eightpost.signals import TimeSeries

#: Largest number of values of a run that is recorded at every step [1]: 160 MB.
_MOST_VALUES = 20_000_000


class DenseRuns:
    """Runs of one system at several steps.

    Args:
        system: Components and connections.
        scenario: Scenario with the channels that the final result has to record.
        record_step: Time between samples of the final result [s].
        engine: Engine of the loop; see `cosim.run`.
        progress: Callback that receives the completed share of each run.
    """

    def __init__(
        self,
        system: System,
        scenario: Scenario,
        *,
        record_step: float,
        engine: str,
        progress: Callable[[float], None] | None,
    ) -> None:
        self._system, self._scenario, self._record_step = system, scenario, record_step
        self._engine, self._progress = engine, progress
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
            result = Session(self._system, scenario, scheme, step).run(self._engine, self._progress)
        except RunInterrupted as interrupted:
            raise RunInterrupted(self.final(interrupted.result)) from interrupted
        self._steps += result.steps
        self._seconds += result.seconds
        self._stepping_seconds += result.stepping_seconds
        return result

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
