"""The master: runs a system at a given step or one that meets a tolerance, and states its coupling error."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import ceil
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cosim.engine.march import ENGINES
from cosim.session.planning import recorded_names
from cosim.session.result import Comparison, Result, compare, difference, stated_error
from cosim.session.session import RunInterrupted, Session
from cosim.session.verdict import LARGEST_ERROR
from cosim.systems.algorithm import ALGORITHMS, Adaptive, Algorithm, GaussSeidel, Implicit
from cosim.systems.coupling import Scenario
from cosim.systems.system import DEFAULT_STEP, System
from eightpost.array_types import Array
from eightpost.display import Summarized, Summary, some
from eightpost.errors import DivergedError, InputError, WiringError, check_number
from eightpost.labelled import data_frame, dataset
from eightpost.progress import Progress, advance, continued, parts
from eightpost.signals import TimeSeries
from eightpost.verdict import Verdict
from eightpost.wiring import Wiring

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture

# ==== Runs that state their coupling error: at given steps that are compared, or with scheme and step chosen =========

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
    (`Result.stated_error`; cosim.session.result). The tolerance is met if the largest stated error is within it
    and the local errors of all bonds are small in the last two runs. The last run is the result.
    """

    #: Coupling error to aim at, of velocities and forces of bonds and of tire forces, in percent of each signal's scale
    #: (cosim.session.result.scales).
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


# ==== The master: runs a coupled system by default, at a given step or with a given algorithm, and repeats a ru ======

# ==== Runs and repetitions ===========================================================================================


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


# ==== Runs for several values of parameters ==========================================================================

Value = float | bool | str

Statistic = Literal["rms", "mean", "minimum", "maximum"]

#: Statistics of a channel; `rms` is about the mean.
STATISTICS: Mapping[Statistic, Callable[[Array], Any]] = MappingProxyType(
    {"rms": np.std, "mean": np.mean, "minimum": np.min, "maximum": np.max}
)


@dataclass(frozen=True, repr=False)
class ParameterSweep(Summarized):
    """Results of runs that differ in their parameters."""

    points: tuple[Mapping[str, Value], ...]  #: Values of the parameters of each run, by `component.parameter`.
    results: tuple[Result, ...]  #: Result of each run.

    def __len__(self) -> int:
        return len(self.results)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that a run changes."""
        return tuple(dict.fromkeys(name for point in self.points for name in point))

    def values(self, channel: str, statistic: Statistic = "rms") -> Array:
        """Return a statistic (P,) of a recorded channel in SI, after settling, for each run.

        Raises:
            InputError: The statistic is unknown.
            MissingChannelError: The channel was not recorded.
        """
        if statistic not in STATISTICS:
            raise InputError(f"statistic is {statistic!r}; it must be one of {', '.join(STATISTICS)}")
        return np.array([float(STATISTICS[statistic](one.settled()[channel])) for one in self.results])

    def _summary(self) -> Summary:
        errors = [one.coupling_error for one in self.results if one.coupling_error is not None]
        worst = Verdict.combined(one.verdict for one in self.results)
        return Summary.of(
            f"Sweep of {len(self)} runs",
            ("parameters", some(self.names)),
            ("verdict", f"{worst.headline} or better"),
            ("coupling error", f"up to {max(errors):.2g} %" if errors else ""),
            ("channels", some(self.results[0].series.names)),
        )

    def to_pandas(self, statistic: Statistic = "rms") -> pd.DataFrame:
        """Return a row for each run: its parameters, and a statistic of each recorded channel in SI.

        Raises:
            MissingExtraError: pandas is not installed.
            InputError: The statistic is unknown.
        """
        series = self.results[0].series
        columns: dict[str, Any] = {name: [point.get(name) for point in self.points] for name in self.names}
        columns |= {channel: self.values(channel, statistic) for channel in series.names}
        return data_frame(columns, np.arange(len(self)), "run", dict(zip(series.names, series.units, strict=True)))

    def to_xarray(self) -> xr.Dataset:
        """Return the recorded channels, in SI, over `run` and `time` [s]; the parameters are coordinates of `run`.

        Raises:
            MissingExtraError: xarray is not installed.
            InputError: The runs were recorded at different times; give the scenario a record_step.
        """
        first = self.results[0].series
        if any(one.series.time.shape != first.time.shape for one in self.results):
            raise InputError("the runs were recorded at different times; give the scenario a record_step")
        variables = {
            name: (("run", "time"), np.stack([one.series[name] for one in self.results]), first.unit(name))
            for name in first.names
        }
        parameters = {name: (("run",), [point.get(name) for point in self.points], "") for name in self.names}
        return dataset(variables, {"time": (("time",), first.time, "s"), **parameters})

    def plot(self, channel: str | None = None, across: str | None = None, *, statistic: Statistic = "rms") -> Picture:
        """Return a picture of a statistic of a channel over a parameter.

        Args:
            channel: Recorded channel; default: the one whose statistic changes most between the runs, relative to the
                largest of all channels with its unit.
            across: Parameter of the horizontal axis; default: the first one.
            statistic: Statistic of the channel.

        Raises:
            InputError: There is no such parameter, or its values are no numbers.
            MissingChannelError: The channel was not recorded.
        """
        from eightpost.report.pictures import Cloud, cloud  # noqa: PLC0415 -- matplotlib takes long to load

        name = across or self.names[0]
        if name not in self.names:
            raise InputError(f"{name!r} is not a parameter of the sweep; those are {', '.join(self.names)}")
        channel = self._most_changed(statistic) if channel is None else channel
        places = [point.get(name) for point in self.points]
        if any(isinstance(place, str) or place is None for place in places):
            raise InputError(f"the values of {name} are not numbers, or a run does not have it: {places}")
        unit = self.results[0].series.unit(channel)
        values = np.array(places, dtype=np.float64), self.values(channel, statistic)
        labels = (name, f"{channel}, {statistic} [{unit}]")
        return cloud(Cloud(values, labels, np.ones(len(self), dtype=np.bool_), is_line=len(self.names) == 1))

    def _most_changed(self, statistic: Statistic) -> str:
        """Return the channel whose statistic changes most between the runs, relative to the largest of its unit."""
        series = self.results[0].series
        table, units = np.stack([self.values(name, statistic) for name in series.names]), np.array(series.units)
        largest = np.array([np.abs(table[units == unit]).max() for unit in series.units])
        return series.names[int(np.argmax(np.ptp(table, axis=1) / np.where(largest > 0.0, largest, 1.0)))]


def sweep_parameters(
    system: System,
    scenario: Scenario,
    parameters: Mapping[str, Sequence[Value]] | Iterable[Mapping[str, Value]],
    *,
    algorithm: Algorithm | Automatic | None = None,
    step: float | None = None,
    compared: bool = True,
) -> ParameterSweep:
    """Run a system for several values of parameters; its components are loaded once.

    Args:
        system: Components and connections.
        scenario: Drive, duration and variables to record.
        parameters: Values of each parameter, of which all combinations are run; or one mapping for each run.
        algorithm: Algorithm of all runs; see `run`.
        step: Coupling step [s].
        compared: Whether each run states its coupling error.

    Raises:
        WiringError: There is no such parameter, or it does not allow a value; no run was started.
        InputError: There is no value.
        StepError: A component failed.
    """
    points = _points(parameters)
    systems = [system.with_parameters(point) for point in points]
    results = [
        run(one, scenario, algorithm=algorithm, step=step, compared=compared, progress=advance)
        for one in parts(systems)
    ]
    return ParameterSweep(points, tuple(results))


def _points(
    parameters: Mapping[str, Sequence[Value]] | Iterable[Mapping[str, Value]],
) -> tuple[Mapping[str, Value], ...]:
    if not isinstance(parameters, Mapping):
        points = tuple(dict(point) for point in parameters)
    else:
        for name, values in parameters.items():
            if isinstance(values, str | bytes) or not isinstance(values, Iterable):
                raise InputError(f"parameters: {name} is {values!r}; give a list of values, such as [0.8, 1.0, 1.2]")
        points = tuple(dict(zip(parameters, values, strict=True)) for values in product(*parameters.values()))
    if not points or not all(points):
        raise InputError("parameters: give at least one parameter with at least one value")
    return points


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
        if tolerance is not None:
            chosen = _with_tolerance(chosen, tolerance)
        return replace(self, algorithm=chosen, step=size if step is None else step)


def _with_tolerance(algorithm: Algorithm | Automatic, percent: float) -> Algorithm | Automatic:
    if isinstance(algorithm, Automatic):
        return replace(algorithm, tolerance=percent)
    if isinstance(algorithm, Adaptive):
        return replace(algorithm, relative=PERCENT * percent)
    raise InputError(f"tolerance: the algorithm {algorithm.name} has no tolerance; use it with default or adaptive")
