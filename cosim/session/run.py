"""The master: runs a system at a given step or one that meets a tolerance, and states its coupling error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, inf
from pathlib import Path

import numpy as np

from cosim.engine.march import ENGINES
from cosim.session.result import Comparison, Result, compare, difference, stated_error
from cosim.session.session import RunInterrupted, Session
from cosim.session.setup import recorded_names
from cosim.session.verdict import LARGEST_ERROR
from cosim.systems.algorithm import SCHEMES, Adaptive, Algorithm, Automatic, GaussSeidel, Implicit, default_scheme
from cosim.systems.coupling import Scenario
from cosim.systems.system import DEFAULT_STEP, System
from eightpost.display import Summarized, Summary
from eightpost.errors import DivergedError, InputError, StepError, WiringError, check_number
from eightpost.progress import Progress, continued
from eightpost.signals import TimeSeries
from eightpost.wiring import Wiring

# ==== What is asked for ==============================================================================================


@dataclass(frozen=True, eq=False)
class Request:
    """A run as it is asked for, from the command to each session.

    Raises:
        WiringError: The system has no component.
        InputError: An argument is of the wrong kind.
    """

    system: System  #: Components and connections.
    scenario: Scenario  #: Drive, duration and recording.
    algorithm: Algorithm | Automatic  #: Algorithm, or the tolerance that the default has to meet.
    step: float | None  #: Coupling step [s]; None if it is to be found, or the default.
    compared: bool = True  #: Whether a run at a given step is compared with others, to state its coupling error.
    engine: str = "auto"  #: Engine of the loop.
    progress: Progress | None = None  #: Callback that receives the completed and the total number of coupling steps.

    def __post_init__(self) -> None:
        if self.engine not in ENGINES:
            raise InputError(f"engine must be one of {', '.join(ENGINES)}, not {self.engine!r}")
        check_number("step", self.step, "s")
        if not self.system.components:
            raise WiringError("the system has no component, so there is nothing to run; give FMUs to System.load")
        if self.progress is not None and not callable(self.progress):
            raise InputError(
                f"progress is {self.progress!r}; give a function of two numbers, the completed and the total"
            )
        if isinstance(self.algorithm, type) or not hasattr(self.algorithm, "name"):
            raise InputError(f"algorithm is {self.algorithm!r}; give an algorithm object such as cosim.GaussSeidel()")


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
        step: Coupling step [s]; by default the step of components that make steps of one size only, if they state it
            (stepSize), else 1 ms for algorithms other than Automatic. The last step is shortened to end at the stop
            time. For Adaptive: the first step to try.
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
    if parameters is not None and not isinstance(parameters, Mapping):
        raise InputError(f"parameters is {parameters!r}; give values by name: {{'lf.compression_scale': 1.2}}")
    request = Request(system, scenario, algorithm or Automatic(), step, compared, engine, progress)
    request = replace(request, system=system.with_parameters(parameters or {}))
    step = request.system.only_step if step is None else step
    if isinstance(request.algorithm, Automatic):
        return _Refinement(request, request.algorithm).result() if step is None else _default_at_step(request, step)
    return _run_at_step(request, request.algorithm, DEFAULT_STEP if step is None else step)


#: An adaptive run is verified at this share of its tolerance: about half the step.
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


# ==== Runs for comparison, recorded at every coupling step ===========================================================

#: Largest number of values of a run that is recorded at every step [1]: 160 MB.
_MOST_VALUES = 20_000_000


class _DenseRuns:
    """Runs of one system at several steps."""

    def __init__(self, request: Request, record_step: float, planned: float = 0.0) -> None:
        self._request, self._scenario, self._record_step = request, request.scenario, record_step
        self._made, self._planned = 0.0, planned
        self._names = recorded_names(request.system, request.scenario)
        self._all_names = tuple(dict.fromkeys((*self._names, *sorted(request.system.decisive))))
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
        session = Session(self._request.system, scenario, scheme, step)
        try:
            result = session.run(self._request.engine, self._progress_of(step))
        except RunInterrupted as interrupted:
            raise RunInterrupted(self.final(interrupted.result)) from interrupted
        self._steps += result.steps
        self._seconds += result.seconds
        self._stepping_seconds += result.stepping_seconds
        return result

    def _progress_of(self, step: float) -> Progress | None:
        if (progress := self._request.progress) is None:
            return None
        before, steps = self._made, self._scenario.stop / step
        self._made += steps
        self._planned = total = max(self._planned, self._made)
        return lambda done, of: progress(before + steps * done / of, total)

    def _dense_step(self, step: float) -> float:
        """Return the step or, if that gives too many values, a multiple of it that divides the record step [s]."""
        multiple = max(1, ceil(len(self._all_names) * self._scenario.stop / step / _MOST_VALUES))
        parts = round(self._record_step / step)
        if parts >= 1 and abs(parts * step - self._record_step) < 1e-9 * self._record_step:
            multiple = next(m for m in range(min(multiple, parts), parts + 1) if parts % m == 0)
        return multiple * step

    def final(self, run: Result) -> Result:
        """Return a run with the samples and channels that the scenario selects, and with the cost of all runs."""
        series = run.series
        stride = round(self._record_step / float(series.time[1] - series.time[0])) if len(series) > 2 else 1
        samples = np.unique(np.append(np.arange(0, len(series), stride), len(series) - 1))
        rows = [series.names.index(name) for name in self._names]
        values = np.ascontiguousarray(series.values[rows][:, samples])
        return replace(
            run,
            series=TimeSeries(series.time[samples], values, self._names, tuple(series.units[row] for row in rows)),
            held_direct=tuple(name for name in run.held_direct if name in self._names),
            seconds=self._seconds,
            stepping_seconds=self._stepping_seconds,
            steps_of_all_runs=self._steps,
        )


# ==== A run at a given step, compared with runs at other steps =======================================================

#: Ratio of tolerances of an adaptive run and the runs it is compared with; it corresponds to about half the step.
_TOLERANCE_RATIO = 8.0


def _run_at_step(request: Request, algorithm: Algorithm, step: float) -> Result:
    """Run at a step and, if it is to be compared, state the coupling error.

    If Ctrl-C is pressed after the run itself was complete, its result has no stated error.
    """
    Session(request.system, request.scenario, algorithm, step)  # raises errors before the recording is changed
    planned = (1.5 if request.compared else 1.0) * request.scenario.stop / step
    runs = _DenseRuns(request, request.scenario.record_step or step, planned)
    result = runs.run(algorithm, step)
    if request.compared and not result.partial and request.system.only_step is not None:
        only = [name for name, c in request.system.components.items() if c.capabilities.only_step]
        text = f"{', '.join(only)}: steps of {request.system.only_step:g} s only (stepSize)"
        result = replace(result, notes=(*result.notes, f"{text}, so no run at another step shows the coupling error"))
    elif request.compared and not result.partial:
        try:
            result = replace(result, stated_error=_error_by_comparison(runs, request, algorithm, result))
        except RunInterrupted as interrupted:
            raise RunInterrupted(runs.final(result)) from interrupted
    return runs.final(result)


def _error_by_comparison(runs: _DenseRuns, request: Request, algorithm: Algorithm, run: Result) -> dict[str, float]:
    """Return the error of a run by comparison with one at twice the step.

    If that run is not possible or not comparable, or the error is too large, half the step is taken as well.
    """
    system, stop, doubled = request.system, request.scenario.stop, 2.0 * run.step

    def at(ratio: float) -> Result | None:
        """Return the run at `ratio` times the step; None if it diverged, or a component does not make such steps."""
        other, step = algorithm, ratio * run.step
        if isinstance(other, Adaptive):
            tolerance = _TOLERANCE_RATIO if ratio > 1.0 else 1.0 / _TOLERANCE_RATIO
            other, step = replace(other, relative=other.relative * tolerance), run.step
        try:
            result = runs.run(other, step)
        except DivergedError:
            return None
        except StepError:
            if system.accepts_any_step:
                raise
            return None  # a component for one step size does not make this one
        return None if result.partial else result

    def compared(coarse: Result, fine: Result) -> Comparison:
        comparison = compare(coarse, fine)
        # The steps of adaptive runs have no common ratio: no order can be observed.
        return replace(comparison, local_order=None) if isinstance(algorithm, Adaptive) else comparison

    fits = abs(round(stop / doubled) * doubled - stop) < 1e-9 * doubled or system.accepts_any_step
    coarse = at(2.0) if isinstance(algorithm, Adaptive) or (doubled <= stop and fits) else None
    comparisons = [] if coarse is None else [compared(coarse, run)]
    if comparisons:
        stated = stated_error(comparisons, system.coupled_with_held)
        error = replace(run, stated_error=stated).coupling_error
        if comparisons[0].reliable and (error or 0.0) <= LARGEST_ERROR:
            return stated
    fine = at(0.5)
    if fine is None:
        return dict.fromkeys(run.series.names, inf) if system.accepts_any_step else {}
    comparisons.append(compared(run, fine))
    # The error of the coarser of two runs: their difference plus the finer run's error.
    finer, apart = stated_error(comparisons, system.coupled_with_held), comparisons[-1].difference
    return {name: apart[name] + finer[name] for name in apart}


# ==== Default algorithm: the scheme and the step are chosen so that the tolerance is met =============================

#: Largest first coupling step [s]: twice the step that suits race cars and their shocks (docs/explanation/coupling.md).
FIRST_STEP = 2e-3

#: Number of runs that diverged or had too large local errors after which Implicit replaces Gauss-Seidel.
_FAILED_RUNS = 2


def _default_at_step(request: Request, step: float) -> Result:
    """Run the default's scheme at a given step: Gauss-Seidel, or Implicit where that diverges."""
    request = replace(request, progress=request.progress and continued(request.progress))
    scheme = default_scheme()
    try:
        result = _run_at_step(request, scheme, step)
    except DivergedError:
        if not request.system.can_repeat_steps:
            raise
        scheme = default_scheme("implicit")
        result = _run_at_step(request, scheme, step)
    return replace(result, algorithm=request.algorithm.name, scheme=scheme.name)


class _Refinement:
    """Runs of one system at steps that are halved from one run to the next."""

    def __init__(self, request: Request, goal: Automatic) -> None:
        self._request, self._goal = request, goal
        stop, first = request.scenario.stop, min(FIRST_STEP, request.scenario.stop)
        self._record_step = request.scenario.record_step or first
        self._parts = max(1, ceil(self._record_step / first * (1.0 - 1e-12)))
        self._dense = _DenseRuns(request, self._record_step, planned=(1.0 + 2.0) * stop / self._step)
        self._scheme: GaussSeidel | Implicit = default_scheme()
        self._last: Result | None = None
        self._comparisons: list[Comparison] = []
        self._failed_runs = 0
        self._tried: list[str] = []

    @property
    def _step(self) -> float:
        return self._record_step / self._parts

    def result(self) -> Result:
        """Halve the step until the tolerance is met or the smallest step is reached; return the last run."""
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
            is_smallest = 0.5 * self._step < self._goal.least * (1.0 - 1e-9)
            if self._last is not None and (self._is_met() or (is_smallest and self._comparisons)):
                return self._final(self._last)
            if is_smallest and failure is not None:
                raise failure
            self._parts *= 2

    def _add(self, run: Result) -> None:
        if self._last is not None:
            self._comparisons.append(compare(self._last, run))
            run = replace(run, stated_error=stated_error(self._comparisons, self._request.system.coupled_with_held))
        self._last = run
        self._failed_runs += not run.is_clean
        error = "not compared" if run.coupling_error is None else f"{run.coupling_error:.2g} %"
        self._tried.append(f"{self._step * 1e3:g} ms {error}{'' if run.is_clean else ', not settled'}")

    def _forget(self) -> None:
        self._last, self._comparisons = None, []

    def _takes_implicit(self) -> bool:
        """Replace Gauss-Seidel at the same step if all components can repeat steps; return whether it was replaced."""
        if isinstance(self._scheme, Implicit) or not self._request.system.can_repeat_steps:
            return False
        self._scheme = default_scheme("implicit")
        self._tried.append("gauss-seidel is not stable enough, implicit")
        self._forget()
        return True

    def _is_met(self) -> bool:
        error = None if self._last is None else self._last.coupling_error
        return error is not None and self._comparisons[-1].reliable and error <= self._goal.tolerance

    def _final(self, run: Result) -> Result:
        """Return the last run, with notes on the runs and on whether the tolerance was met."""
        goal, scheme = self._goal, self._scheme
        values = "" if isinstance(scheme, Implicit) else f" with {scheme.values} values"
        notes = [
            f"the default used {scheme.name}{values} at {run.step * 1e3:g} ms; coupling error stated by comparing "
            f"runs: {', '.join(self._tried)}"
        ]
        if not self._is_met():
            notes.append(
                f"the stated coupling error of {run.coupling_error:.2g} % does not meet the tolerance of "
                f"{goal.tolerance:g} %, and steps below {goal.least * 1e3:g} ms were not tried: allow a smaller step, "
                "or a larger tolerance"
            )
        final = self._dense.final(run)
        return replace(
            final, algorithm=goal.name, scheme=scheme.name, tolerance=goal.tolerance, notes=(*notes, *final.notes)
        )


# ==== Case: what a system file or a package says to run ==============================================================

#: Tolerances are given in percent.
PERCENT = 0.01


@dataclass(frozen=True, repr=False)
class Case(Summarized):
    """Contents of a system file or a package, ready to run."""

    name: str  #: Name of the system.
    system: System  #: Components, bonds, connections, values.
    scenario: Scenario  #: Drive, times and recording.
    algorithm: Algorithm | Automatic = field(default_factory=Automatic)  #: Algorithm of the run; a package states none.
    step: float | None = None  #: Coupling step [s]; None if none is stated.
    fmus: Mapping[str, Path] = field(default_factory=dict)  #: FMU files by component.
    notes: tuple[str, ...] = ()  #: Notes for the reader: names that were changed, values that match nothing.

    def _summary(self) -> Summary:
        step = "" if self.step is None else f", step {1e3 * self.step:g} ms"
        return Summary.of(
            f"System {self.name}",
            *self.system.summary_rows(),
            *self.scenario.summary_rows(),
            ("algorithm", f"{self.algorithm.name}{step}"),
            ("notes", f"{len(self.notes)}; see .notes" if self.notes else ""),
        )

    @property
    def wiring(self) -> Wiring:
        """FMUs and connections, for a package (`builder.ssp`) or an assembled FMU (`builder.assembly`)."""
        step = self.step or DEFAULT_STEP
        return self.system.wiring(self.fmus, name=self.name, step=step, stop=self.scenario.stop)

    def with_coupling(
        self, algorithm: str | None = None, step: float | None = None, tolerance: float | None = None
    ) -> Case:
        """Return the case with another coupling; None keeps that of the file.

        Args:
            algorithm: Name of an algorithm; the step of the file is dropped if the algorithm finds its own.
            step: Coupling step [s].
            tolerance: Tolerated coupling error [%].

        Raises:
            InputError: A tolerance is given, but the algorithm has none.
        """
        chosen, size = self.algorithm, self.step
        if algorithm is not None and algorithm != chosen.name:
            chosen = SCHEMES[algorithm]
            size = None if isinstance(chosen, Automatic) else size
        if tolerance is not None and isinstance(chosen, Automatic):
            chosen = replace(chosen, tolerance=tolerance)
        elif tolerance is not None and isinstance(chosen, Adaptive):
            chosen = replace(chosen, relative=PERCENT * tolerance)
        elif tolerance is not None:
            raise InputError(
                f"tolerance: the algorithm {chosen.name} has no tolerance; use it with default or adaptive"
            )
        return replace(self, algorithm=chosen, step=size if step is None else step)
