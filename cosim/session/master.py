"""The master: runs a coupled system by default, at a given step or with a given algorithm, and repeats a run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cosim.engine.loop import ENGINES
from cosim.results.error_estimate import difference
from cosim.results.result import Result
from cosim.session.automatic import SCHEMES, Automatic, Refinement, default_scheme, run_at_step, run_default_at_step
from cosim.session.session import Session
from cosim.systems.algorithm import Adaptive, Algorithm
from cosim.systems.coupling import Scenario
from cosim.systems.system import DEFAULT_STEP, System
from eightpost.array_types import Array
from eightpost.display import Summarized, Summary, some
from eightpost.errors import InputError, WiringError, check_number
from eightpost.labelled import data_frame, dataset
from eightpost.progress import Progress, advance, parts
from eightpost.verdict import Verdict
from eightpost.wiring import Wiring

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture


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
