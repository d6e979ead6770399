"""A run of a coupled system: the default's choice of scheme and step, runs at a given step, their coupling error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from cosim.algorithm import ALGORITHMS, Adaptive, Algorithm, GaussSeidel, Implicit
from cosim.engine.loop import ENGINES
from cosim.error_estimate import Comparison, compare, difference, stated_error
from cosim.result import Result
from cosim.session import RunInterrupted, Session
from cosim.setup import recorded_names
from cosim.system import Scenario, System
from cosim.verdict import LARGEST_ERROR
from eightpost.errors import DivergedError, InputError
from eightpost.signals import TimeSeries

# ---- Runs of one system for comparison ------------------------------------------------------------------------------

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


# ---- Run at a given step, compared with runs at other steps to state its coupling error -----------------------------

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


# ---- Default algorithm ----------------------------------------------------------------------------------------------

#: Largest first coupling step [s]: twice the step that suits race cars and their shocks (docs/coupling.md).
FIRST_STEP = 2e-3

#: Number of runs that diverged or had too large local errors after which Implicit replaces Gauss-Seidel.
_FAILED_RUNS = 2


@dataclass(frozen=True, slots=True)
class Automatic:
    """Gauss-Seidel, or Implicit if that is not stable, at a step for which successive runs agree.

    The step is halved from run to run. The differences between the runs give the error of the last one per channel
    (`Result.stated_error`; cosim.error_estimate). The tolerance is met if the largest stated error is within it and
    the local errors of all bonds are small in the last two runs. The last run is the result.

    Args:
        tolerance: Coupling error to aim at, of velocities and forces of bonds and of tire forces, in percent of each
            signal's scale (cosim.error_estimate.scales).
        least: Smallest coupling step to try [s].
    """

    tolerance: float = 0.2
    least: float = 1e-5
    name: str = "default"

    def __post_init__(self) -> None:
        if not (self.tolerance > 0.0 and self.least > 0.0):
            raise InputError(
                f"tolerance and least step must be positive, not {self.tolerance!r} % and {self.least!r} s"
            )


#: Algorithms by the names that the command line and system files use.
SCHEMES: Mapping[str, Algorithm | Automatic] = {"default": Automatic(), **ALGORITHMS}


def default_scheme(name: str = "gauss-seidel") -> GaussSeidel | Implicit:
    """Return a scheme of the default by its name, with the coupling values that the default uses."""
    return Implicit() if name == Implicit().name else GaussSeidel(values="parabolic")


def can_repeat_steps(system: System) -> bool:
    """Return whether every component can save and restore its state."""
    return all(c.capabilities.state for c in system.components.values())


def run_automatic(
    system: System, scenario: Scenario, request: Automatic, engine: str, progress: Callable[[float], None] | None
) -> Result:
    """Run at steps that halve until the stated error is within the tolerance; return the last run.

    Raises:
        DivergedError: The coupling diverged at every step.
        StepError: A component failed.
    """
    return _Refinement(system, scenario, request, engine, progress).result()


def run_default_at_step(
    system: System,
    scenario: Scenario,
    request: Automatic,
    step: float,
    *,
    engine: str,
    progress: Callable[[float], None] | None,
    compared: bool,
) -> Result:
    """Run the default's scheme at a given step: Gauss-Seidel, or Implicit where that diverges.

    Raises:
        DivergedError: The coupling diverged.
        StepError: A component failed.
    """
    scheme = default_scheme()
    try:
        result = run_at_step(system, scenario, scheme, step, engine=engine, progress=progress, compared=compared)
    except DivergedError:
        if not can_repeat_steps(system):
            raise
        scheme = default_scheme("implicit")
        result = run_at_step(system, scenario, scheme, step, engine=engine, progress=progress, compared=compared)
    return replace(result, algorithm=request.name, scheme=scheme.name)


class _Refinement:
    """Runs of one system at steps that are halved from one run to the next."""

    def __init__(
        self,
        system: System,
        scenario: Scenario,
        request: Automatic,
        engine: str,
        progress: Callable[[float], None] | None,
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
        """Halve the step until the tolerance is met or the smallest step is reached."""
        while True:
            failure = self._run()
            if self._failed_runs >= _FAILED_RUNS and self._takes_implicit():
                continue
            if self._is_met() or (self._is_smallest() and self._comparisons):
                return self._final()
            if self._is_smallest() and failure is not None:
                raise failure
            self._parts *= 2

    def _run(self) -> DivergedError | None:
        """Make one run and compare it with the one before; return the error if it diverged."""
        try:
            run = self._dense.run(self._scheme, self._step)
        except DivergedError as error:
            self._forget()
            self._failed_runs += 1
            self._tried.append(f"{self._step * 1e3:g} ms diverged")
            return error
        if self._runs:
            self._comparisons.append(compare(self._runs[-1], run))
            run = replace(run, stated_error=stated_error(self._comparisons, self._held))
        self._runs = [run]
        self._failed_runs += not run.is_clean
        self._tried.append(f"{self._step * 1e3:g} ms {self._shown_error}")
        return None

    def _forget(self) -> None:
        self._runs, self._comparisons = [], []

    def _takes_implicit(self) -> bool:
        """Replace Gauss-Seidel at the same step if all components can repeat steps; return whether it was replaced."""
        if isinstance(self._scheme, Implicit) or not can_repeat_steps(self._system):
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


# ---- Repetition of a run with a finer step, to show how far its numbers depend on the coupling step -----------------

#: An adaptive run is repeated at this share of its tolerance: about half the step.
_FINER_TOLERANCE = 1.0 / 8.0


@dataclass(frozen=True)
class Verification:
    """A run and its repetition.

    Args:
        finer: Result of the repetition.
        difference: Root mean square of the difference after settling per channel, in percent of the finer run's
            standard deviation.
    """

    finer: Result
    difference: Mapping[str, float]


def verify(
    system: System,
    scenario: Scenario,
    algorithm: Algorithm | Automatic,
    result: Result,
    *,
    progress: Callable[[float], None] | None = None,
    engine: str = "auto",
) -> Verification:
    """Repeat a run with the same scheme at half its coupling step; an adaptive run at an eighth of its tolerance.

    Args:
        system: System of the run.
        scenario: Scenario of the run.
        algorithm: Algorithm of the run; for the default, the scheme that it chose is repeated.
        result: Result of the run.
        progress: Callback that receives the completed share, 0 to 1.
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


# ---- The master -----------------------------------------------------------------------------------------------------

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
