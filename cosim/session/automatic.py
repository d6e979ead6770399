"""Runs that state their coupling error: at given steps that are compared, or with scheme and step chosen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from cosim.results.error_estimate import Comparison, compare, stated_error
from cosim.results.result import Result
from cosim.results.rules import LARGEST_ERROR
from cosim.session.planning import recorded_names
from cosim.session.session import RunInterrupted, Session
from cosim.systems.algorithm import ALGORITHMS, Adaptive, Algorithm, GaussSeidel, Implicit
from cosim.systems.coupling import Scenario
from cosim.systems.system import System
from eightpost.errors import DivergedError, InputError, check_number
from eightpost.progress import Progress, continued
from eightpost.signals import TimeSeries

# ==== Given steps ====================================================================================================

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


# ==== Default algorithm: the scheme and the step are chosen so that the tolerance is met =============================

#: Largest first coupling step [s]: twice the step that suits race cars and their shocks (docs/explanation/coupling.md).
FIRST_STEP = 2e-3

#: Number of runs that diverged or had too large local errors after which Implicit replaces Gauss-Seidel.
_FAILED_RUNS = 2


@dataclass(frozen=True, slots=True)
class Automatic:
    """Gauss-Seidel, or Implicit if that is not stable, at a step for which successive runs agree.

    The step is halved from run to run. The differences between the runs give the error of the last one per channel
    (`Result.stated_error`; cosim.results.error_estimate). The tolerance is met if the largest stated error is within it
    and the local errors of all bonds are small in the last two runs. The last run is the result.
    """

    #: Coupling error to aim at, of velocities and forces of bonds and of tire forces, in percent of each signal's scale
    #: (cosim.results.error_estimate.scales).
    tolerance: float = 0.2
    least: float = 1e-5  #: Smallest coupling step to try [s].
    name: str = "default"

    def __post_init__(self) -> None:
        check_number("tolerance", self.tolerance, "%")
        check_number("least", self.least, "s")
        if not (self.tolerance > 0.0 and self.least > 0.0):
            raise InputError(
                f"tolerance and least step must be positive, not {self.tolerance!r} % and {self.least!r} s"
            )


#: Algorithms by the names that the command line and system files use.
SCHEMES: Mapping[str, Algorithm | Automatic] = {"default": Automatic(), **ALGORITHMS}


def default_scheme(name: str = "gauss-seidel") -> GaussSeidel | Implicit:
    """Return a scheme of the default by its name, with the coupling values that the default uses."""
    return Implicit() if name == Implicit().name else GaussSeidel(values="parabolic")


def _can_repeat_steps(system: System) -> bool:
    """Return whether every component can save and restore its state."""
    return all(c.capabilities.state for c in system.components.values())


def run_default_at_step(
    system: System,
    scenario: Scenario,
    request: Automatic,
    step: float,
    *,
    engine: str,
    progress: Progress | None,
    compared: bool,
) -> Result:
    """Run the default's scheme at a given step: Gauss-Seidel, or Implicit where that diverges.

    Raises:
        DivergedError: The coupling diverged.
        StepError: A component failed.
    """
    scheme, progress = default_scheme(), progress and continued(progress)
    try:
        result = run_at_step(system, scenario, scheme, step, engine=engine, progress=progress, compared=compared)
    except DivergedError:
        if not _can_repeat_steps(system):
            raise
        scheme = default_scheme("implicit")
        result = run_at_step(system, scenario, scheme, step, engine=engine, progress=progress, compared=compared)
    return replace(result, algorithm=request.name, scheme=scheme.name)


class Refinement:
    """Runs of one system at steps that are halved from one run to the next.

    Args:
        system: Components and connections.
        scenario: Drive, duration and recording.
        request: Tolerance and smallest step.
        engine: Engine of the loop; see `cosim.run`.
        progress: Callback that receives the completed and the total number of coupling steps of all runs.
    """

    def __init__(
        self,
        system: System,
        scenario: Scenario,
        request: Automatic,
        engine: str,
        progress: Progress | None,
    ) -> None:
        self._system, self._request = system, request
        first = min(FIRST_STEP, scenario.stop)
        self._record_step = scenario.record_step or first
        self._parts = max(1, ceil(self._record_step / first * (1.0 - 1e-12)))
        self._dense = DenseRuns(
            system,
            scenario,
            record_step=self._record_step,
            engine=engine,
            progress=progress,
            planned=(1.0 + 2.0) * scenario.stop / self._step,
        )
        self._scheme: GaussSeidel | Implicit = default_scheme()
        self._held = system.coupled_with_held
        self._runs: list[Result] = []
        self._comparisons: list[Comparison] = []
        self._failed_runs = 0
        self._tried: list[str] = []

    @property
    def _step(self) -> float:
        return self._record_step / self._parts

    def result(self) -> Result:
        """Halve the step until the tolerance is met or the smallest step is reached; return the last run.

        Raises:
            DivergedError: The coupling diverged at every step.
            StepError: A component failed.
        """
        while True:
            failure: DivergedError | None = None
            try:
                self._add(self._dense.run(self._scheme, self._step))
            except DivergedError as error:
                failure = error
                self._forget()
                self._failed_runs += 1
                self._tried.append(f"{self._step * 1e3:g} ms diverged")
            if self._failed_runs >= _FAILED_RUNS and self._takes_implicit():
                continue
            if self._is_met() or (self._is_smallest() and self._comparisons):
                return self._final()
            if self._is_smallest() and failure is not None:
                raise failure
            self._parts *= 2

    def _add(self, run: Result) -> None:
        """Add a run, which is compared with the one before."""
        if self._runs:
            self._comparisons.append(compare(self._runs[-1], run))
            run = replace(run, stated_error=stated_error(self._comparisons, self._held))
        self._runs = [run]
        self._failed_runs += not run.is_clean
        self._tried.append(f"{self._step * 1e3:g} ms {self._shown_error}")

    def _forget(self) -> None:
        self._runs, self._comparisons = [], []

    def _takes_implicit(self) -> bool:
        """Replace Gauss-Seidel at the same step if all components can repeat steps; return whether it was replaced."""
        if isinstance(self._scheme, Implicit) or not _can_repeat_steps(self._system):
            return False
        self._scheme = default_scheme("implicit")
        self._tried.append("gauss-seidel is not stable enough, implicit")
        self._forget()
        return True

    @property
    def _worst(self) -> float | None:
        return self._runs[-1].coupling_error if self._runs else None

    @property
    def _shown_error(self) -> str:
        local = "" if self._runs[-1].is_clean else ", not settled"
        return f"{'not compared' if self._worst is None else f'{self._worst:.2g} %'}{local}"

    def _is_met(self) -> bool:
        return self._worst is not None and self._comparisons[-1].reliable and self._worst <= self._request.tolerance

    def _is_smallest(self) -> bool:
        return 0.5 * self._step < self._request.least * (1.0 - 1e-9)

    def _final(self) -> Result:
        """Return the last run, with notes on the runs and on whether the tolerance was met."""
        run, worst = self._runs[-1], self._worst
        values = "" if isinstance(self._scheme, Implicit) else f" with {self._scheme.values} values"
        notes: tuple[str, ...] = (
            f"the default used {self._scheme.name}{values} at {run.step * 1e3:g} ms; coupling error stated by "
            f"comparing runs: {', '.join(self._tried)}",
        )
        if not self._is_met():
            notes += (
                f"the stated coupling error of {worst:.2g} % does not meet the tolerance of "
                f"{self._request.tolerance:g} %, and steps below {self._request.least * 1e3:g} ms were not tried: "
                "allow a smaller step, or a larger tolerance",
            )
        final = self._dense.final(run)
        return replace(
            final,
            algorithm=self._request.name,
            scheme=self._scheme.name,
            tolerance=self._request.tolerance,
            notes=notes + final.notes,
        )
