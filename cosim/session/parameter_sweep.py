"""Runs of a system for several values of parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cosim.session.result import Result
from cosim.session.run import run
from cosim.systems.algorithm import Algorithm, Automatic
from cosim.systems.coupling import Scenario
from cosim.systems.system import System
from eightpost.array_types import Array
from eightpost.display import Summarized, Summary, some
from eightpost.errors import InputError
from eightpost.labelled import data_frame, dataset
from eightpost.progress import advance, parts
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture

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
        run(changed, scenario, algorithm=algorithm, step=step, compared=compared, progress=advance)
        for changed in parts(systems)
    ]
    return ParameterSweep(points, tuple(results))


def _points(
    parameters: Mapping[str, Sequence[Value]] | Iterable[Mapping[str, Value]],
) -> tuple[Mapping[str, Value], ...]:
    points: tuple[Mapping[str, Value], ...]
    if not isinstance(parameters, Mapping):
        points = tuple(dict(point) for point in parameters)
    else:
        for name, values in parameters.items():
            if isinstance(values, str | bytes) or not isinstance(values, Iterable):
                raise InputError(f"parameters: {name} is {values!r}; give a list of values, such as [0.8, 1.0, 1.2]")
        names = [str(name) for name in parameters]
        points = tuple(dict(zip(names, values, strict=True)) for values in product(*parameters.values()))
    if not points or not all(points):
        raise InputError("parameters: give at least one parameter with at least one value")
    return points
