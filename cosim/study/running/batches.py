"""Runs of a study by the machine, in batches: setups that it cannot run or finish are left to the FMUs."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from operator import mul
from typing import Any, NamedTuple, Protocol

import numpy as np

from cosim.components.component import to_si
from cosim.components.fmu_component import FmuComponent
from cosim.session.result import Result, judged_by
from cosim.session.setup import Limit, RunSetup
from cosim.session.verdict import LARGEST_ERROR, LARGEST_RESIDUAL, BondEnergy, Coupled
from cosim.study.definition import Build, Drive, Setup, Study
from cosim.study.measures import Filtered
from cosim.study.running.machine import BatchMeasures, ChannelBand, FmuVehicle, Plan, read_vehicle
from cosim.systems.algorithm import default_scheme
from cosim.systems.coupling import Scenario
from cosim.systems.system import System
from eightpost.array_types import Array
from eightpost.errors import EightpostError, FmuError
from eightpost.machine import Batch, BatchResult, NotInBatchError, ShockData, joined
from eightpost.signals import TimeSeries
from eightpost.workers.pool import heartbeat

# ==== Estimate of coupling errors from the local errors that the bonds of each run measure ===========================


@dataclass(frozen=True)
class ErrorModel:
    """Gains from the local errors of bond ends to coupling errors."""

    ends: tuple[str, ...]  #: Names of the bond ends with local errors, as `bond.velocity` or `bond.force`.
    #: Gain of each end for each compared channel; the errors are in percent of the channel's scale.
    channels: Mapping[str, tuple[float, ...]]
    #: Gain of each end for each measure; the errors are in the measure's SI unit.
    measures: Mapping[str, tuple[float, ...]]

    def of(self, local: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Return the estimated errors of one run, or of n runs.

        Args:
            local: Local error of each bond end, in SI (n,).

        Returns:
            Largest error of the compared channels, in percent of the channel's scale (n,); and the error of every
            measure that the pilots had, in its SI unit (n,).
        """
        channels, measures = (self._estimated(table, local) for table in (self.channels, self.measures))
        return np.max([*channels.values()], axis=0, initial=0.0), measures

    def _estimated(self, gains: Mapping[str, tuple[float, ...]], local: Mapping[str, Any]) -> dict[str, Any]:
        squares = [local[end] ** 2 for end in self.ends]
        nothing = np.zeros(np.shape(next(iter(local.values()), 0.0)))
        return {name: np.sqrt(sum(map(mul, row, squares), nothing)) for name, row in gains.items()}


class Pilot(NamedTuple):
    """A run at the study's step, with known coupling errors."""

    local: Mapping[str, float]  #: Local error of each bond end, in SI.
    channels: Mapping[str, float]  #: Error of each compared channel, in percent of the channel's scale.
    measures: Mapping[str, float]  #: Error of each measure of the run's drive, in its SI unit.


def fit_error_model(pilots: Sequence[Pilot]) -> ErrorModel:
    """Return the gains fitted to the errors of one or more pilots."""
    local = [pilot.local for pilot in pilots]
    ends = tuple(end for end in local[0] if any(one[end] > 0.0 for one in local))
    squares = np.array([[one[end] ** 2 for end in ends] for one in local]).reshape(len(pilots), len(ends))
    measures = dict.fromkeys(name for pilot in pilots for name in pilot.measures)
    return ErrorModel(
        ends,
        channels={n: _gains(squares, [p.channels.get(n) for p in pilots], _middle) for n in pilots[0].channels},
        measures={n: _gains(squares, [p.measures.get(n) for p in pilots], _mean) for n in measures},
    )


def local_errors(result: Result) -> dict[str, float]:
    """Return the local error of every bond end of a run, in SI."""
    found: dict[str, float] = {}
    for bond, coupled in result.coupled.items():
        found |= {f"{bond}.velocity": coupled.velocity_error, f"{bond}.force": coupled.force_error}
    return found


def _gains(
    squares: Array, errors: Sequence[float | None], excess: Callable[[Array, Array], float]
) -> tuple[float, ...]:
    """Return the gains (E,) fitted to the pilots that have the error; zeros if it is zero for all.

    `excess` returns the factor by which the fitted squares are too large; the gains are divided by it.
    """
    from scipy.optimize import nnls  # noqa: PLC0415 -- only the process that chooses the coupling needs it

    known = np.array([error is not None for error in errors])
    known_squares = np.array([float(error) ** 2 for error in errors if error is not None])
    if not known_squares.any() or squares.shape[1] == 0:
        return tuple(0.0 for _ in range(squares.shape[1]))
    rows = squares[known]
    sizes = rows.mean(axis=0)  # of order 1, for the solver
    gains = np.asarray(
        nnls(rows / sizes, known_squares / known_squares.mean())[0] * known_squares.mean() / sizes, dtype=np.float64
    )
    return tuple((gains / excess(rows @ gains, known_squares)).tolist())


def _middle(estimated: Array, known_squares: Array) -> float:
    """Return the factor that balances the largest over- and underestimate of the errors of channels."""
    usual = known_squares > 1e-2 * known_squares.mean()
    ratios = estimated[usual] / known_squares[usual]
    return float(np.sqrt(ratios.min() * ratios.max())) if ratios.min() > 0.0 else 1.0


def _mean(estimated: Array, known_squares: Array) -> float:
    """Return the factor of the mean squares; the errors of measures change sign, and may be zero by chance."""
    return float(estimated.mean() / known_squares.mean()) or 1.0


# ==== Batches ========================================================================================================


#: Velocity up to which the mean slope of the shocks' curves is the damping around which their ports are solved [m/s].
_USUAL_VELOCITY = 0.2

#: Scheme in whose form a run is planned; the machine has its own.
GAUSS_SEIDEL = "gauss-seidel"

#: Number of batches that are evaluated together, which takes less time than one after the other.
_GROUP = 8


class Models(Protocol):
    """FMUs and scenarios of a study."""

    study: Study

    @property
    def fmus(self) -> dict[str, FmuComponent]:
        """A component of every FMU, by file."""

    def system(self, setup: Setup) -> System:
        """Return the coupled system of a setup."""

    def scenario(self, drive: Drive, *, extra: Iterable[str] = ()) -> Scenario:
        """Return the scenario of a drive."""

    def shock_data(self, build: Build) -> ShockData | None:
        """Return a build as the machine takes it; None if its FMU refuses its parameters."""


class Estimator(Protocol):
    """Estimate of errors from local errors."""

    def of(self, local: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Return the estimated errors; see `ErrorModel.of`."""


#: Units of the values that both ends of a bond exchange: velocity and force.
_UNITS = ("m/s", "N")


class RunSummary(NamedTuple):
    """What a row states of one run besides its measures; the names are those of cosim.session.result.Result."""

    share_beyond_fit: Mapping[str, float]
    share_beyond_settings: Mapping[str, float]
    share_untested_settings: Mapping[str, float]
    share_tire_off: Mapping[str, float | None]
    energy: Mapping[str, BondEnergy]
    coupled: Mapping[str, Coupled]
    ended_by: str = ""
    ended_at: float | None = None


class _Group:
    """What several runs on one drive state besides their measures: C bonds, W limits, n runs.

    Attributes:
        percent: Largest local error of a bond, in percent of its scale (n,).
        local: Local errors by bond end, SI (n,) each.
    """

    def __init__(
        self, setup: RunSetup, corners: tuple[str, ...], result: BatchResult, beyond: Array, records: int
    ) -> None:
        self._corners, self._limits, self._beyond = corners, setup.limits, beyond
        self._energy = np.stack([result.residual, result.transferred])
        variance = result.squares / records - (result.total / records) ** 2
        spread, error = np.sqrt(np.maximum(variance, 0.0)), np.sqrt(result.defect / records)
        ends = [(way, c) for way in range(2) for c in range(len(corners))]
        scales = judged_by({end: spread[end] for end in ends}, {end: _UNITS[end[0]] for end in ends})
        scale = np.array([scales[end] for end in ends]).reshape(spread.shape)
        self._ends = np.stack([error, spread, scale])
        self.percent = 100.0 * (error / scale).max(axis=(0, 1))
        self.local = {
            f"{corner}.{end}": error[way, c]
            for c, corner in enumerate(corners)
            for way, end in enumerate(("velocity", "force"))
        }
        self._estimate: tuple[Estimator, list[float], dict[str, list[float]]] | None = None

    @cached_property
    def is_marked(self) -> list[bool]:
        """Whether a row has marks besides that of its coupling error, of each run."""
        residual, transferred = self._energy
        relative = np.divide(residual, transferred, out=np.zeros_like(residual), where=transferred != 0.0)
        made = np.abs(relative) > LARGEST_RESIDUAL
        found: list[bool] = (self._beyond.any(axis=0) | made.any(axis=0)).tolist()
        return found

    def summary(self, k: int) -> RunSummary:
        """Return the summary of one run."""
        (errors, spreads, scales), energy = (array[..., k].tolist() for array in (self._ends, self._energy))
        shares = self._limits.shares([*self._beyond[:, k].tolist(), 1.0])
        return RunSummary(
            shares["share_beyond_fit"],
            shares["share_beyond_settings"],
            shares["share_untested_settings"],
            shares["share_tire_off"],
            {corner: BondEnergy(energy[0][c], energy[1][c]) for c, corner in enumerate(self._corners)},
            {
                corner: Coupled(errors[0][c], spreads[0][c], errors[1][c], spreads[1][c], scales[0][c], scales[1][c])
                for c, corner in enumerate(self._corners)
            },
        )

    def estimate(self, model: Estimator, k: int) -> tuple[float, dict[str, float]]:
        """Return the estimated errors of one run; see `ErrorModel.of`."""
        if self._estimate is None or self._estimate[0] is not model:
            largest, measures = model.of(self.local)
            self._estimate = model, largest.tolist(), {name: several.tolist() for name, several in measures.items()}
        _, worst, errors = self._estimate
        return worst[k], {name: several[k] for name, several in errors.items()}


@dataclass(frozen=True, slots=True)
class BatchRun:
    """One setup on one drive."""

    values: Mapping[str, float]  #: Measures by name, in SI.
    series: TimeSeries | None  #: Channels that were asked for; None if none were.
    _group: _Group  #: Runs of which this is one.
    _place: int  #: Place among them.

    @property
    def summary(self) -> RunSummary | None:
        """What its row states besides measures and errors; None if nothing."""
        return self._group.summary(self._place) if self._group.is_marked[self._place] else None

    @property
    def local(self) -> dict[str, float]:
        """Local errors by bond end, SI."""
        return {end: float(errors[self._place]) for end, errors in self._group.local.items()}

    def estimate(self, model: Estimator) -> tuple[float, dict[str, float]]:
        """Return the estimated errors; see `ErrorModel.of`."""
        return self._group.estimate(model, self._place)

    def channels(self) -> TimeSeries:
        """Return the channels that were asked for.

        Raises:
            ValueError: None were.
        """
        if self.series is None:
            raise ValueError("no channels were asked for")
        return self.series


class _DriveBatch:
    """Batches of one drive."""

    def __init__(
        self,
        models: Models,
        drive: Drive,
        step: float,
        vehicle: FmuVehicle,
        damping: Array,
        recorded: Sequence[str],
        measured: bool,
        single: bool,
    ) -> None:
        study = models.study
        first = study.space.setup(0)  # any setup: all have the same wiring, and a large space is not enumerated
        setup = RunSetup.of(models.system(first), models.scenario(drive), default_scheme(GAUSS_SEIDEL), step)
        times = setup.times[setup.recorded == 1]
        self._measures = BatchMeasures(study.measures_of(drive) if measured else (), times, study.settling)
        series = tuple(dict.fromkeys((*self._measures.series, *recorded)))
        self._plan = Plan(setup, study.vehicle.name, vehicle, damping, self._measures.quantities, series, single=single)
        self._units = {name: to_si(setup.system.output(name))[1] for name in series}
        self._recorded = tuple(recorded)
        self._batch, self._setup, self._study = Batch(self._plan.run), setup, study
        self.lanes = self._batch.lanes
        self._watched = [self._place_of(limit) for limit in setup.limits.watched]

    def _place_of(self, limit: Limit) -> tuple[str, int]:
        """Return the array of a result in which the time beyond a limit is, and its row."""
        if limit in self._plan.limits:
            return "watched", self._plan.limits.index(limit)
        return "beyond", self._plan.corners.index(limit.signal.partition(".")[0])

    def runs(self, shocks: Sequence[Sequence[ShockData]]) -> list[BatchRun | None]:
        """Return the runs of setups; None for those that did not end regularly."""
        parts = [self._sums(shocks[first : first + self.lanes]) for first in range(0, len(shocks), self.lanes)]
        result = joined([own for own, _, _ in parts])
        others = [values for _, several, _ in parts for values in several]
        series = [one for _, _, several in parts for one in several]
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            values, group = self._measures.values(result.statistics), self._group(result)
            # beyond the largest error, forces change too fast for the step
            regular = (result.ended < 0) & (group.percent <= LARGEST_ERROR)
            regular &= np.isfinite(np.array([*values.values()]).reshape(-1, len(others))).all(axis=0)
        columns = {name: several.tolist() for name, several in values.items()}
        found = list[BatchRun | None]()
        for k, (ok, other, channels) in enumerate(zip(regular.tolist(), others, series, strict=True)):
            if not ok or other is None or not all(map(math.isfinite, other.values())):
                found.append(None)
            else:
                own = {name: several[k] for name, several in columns.items()} | other
                found.append(BatchRun(own, channels, group, k))
        return found

    def _group(self, result: BatchResult) -> _Group:
        rows, settled = self._plan.rows.size, max(1, self._plan.rows.size - self._plan.run.settling)
        beyond = np.array([getattr(result, name)[place] for name, place in self._watched]) / settled
        return _Group(self._setup, self._plan.corners, result, beyond.reshape(-1, result.ended.size), rows - 1)

    def _sums(
        self, shocks: Sequence[Sequence[ShockData]]
    ) -> tuple[BatchResult, list[dict[str, float] | None], list[TimeSeries | None]]:
        """Return the sums of one batch; of each setup the measures that need its series, None if one has none; and the
        channels that were asked for.
        """
        heartbeat()
        result = self._batch.run(shocks)
        filtered = {key: self._batch.filtered(key[0], sections) for key, sections in self._measures.bands.items()}
        own = [
            self._batch.statistics_of(q, [filtered[channel, band] for channel in q.channels])[..., : len(shocks)]
            for q, band in self._measures.filtered_quantities
        ]
        others = [self._from_series(result, filtered, k) for k in range(len(shocks))]
        series = [self._series(result, self._recorded, k) if self._recorded else None for k in range(len(shocks))]
        return result.kept(own), others, series

    def _from_series(
        self, result: BatchResult, filtered: Mapping[ChannelBand, Array], k: int
    ) -> dict[str, float] | None:
        if not self._measures.others:
            return {}
        try:
            run = Filtered(self._series(result, self._measures.series, k))
            for (name, band), several in filtered.items():
                run.keep(name, band, several[:, k].astype(np.float64))
            return {m.name: m.drawn_from(run, start=self._study.settling) for m in self._measures.others}
        except EightpostError:
            return None

    def _series(self, result: BatchResult, names: Sequence[str], k: int) -> TimeSeries:
        columns = [self._plan.series.index(name) for name in names]
        rows = result.values[:, columns, k].T.astype(np.float64, order="C")
        return TimeSeries(self._plan.rows, rows, tuple(names), tuple(self._units[name] for name in names))


class Batches:
    """Batches of a study at one step.

    Args:
        step: Step [s].
        recorded: Names of channels whose series are wanted.
        measured: Whether the runs have measures.
        single: Whether they are in single precision.

    Attributes:
        left_out: Builds whose setups run through the FMUs, each with the reason.

    Raises:
        NotInBatchError: The study cannot run as a batch; the message is the reason.
    """

    def __init__(
        self,
        models: Models,
        step: float,
        recorded: Sequence[str] = (),
        *,
        measured: bool = True,
        single: bool = False,
    ) -> None:
        self._study = study = models.study
        self._shocks, self.left_out = _data_of(models)
        fmus, own = models.fmus, study.vehicle
        vehicle = read_vehicle(fmus[str(own.fmu)], own.fmu, own.parameters)
        slopes = [shock.mean_slope(_USUAL_VELOCITY) for shock in self._shocks.values() if shock is not None]
        if not slopes:
            raise NotInBatchError("no FMU of a shock accepts its parameters")
        damping = np.full(len(study.corners), float(np.median(slopes)))
        try:
            self._drives = {
                drive.name: _DriveBatch(models, drive, step, vehicle, damping, recorded, measured, single)
                for drive in study.drives
            }
        except (FmuError, OSError) as error:
            raise NotInBatchError(str(error)) from error

    def for_shocks(self, models: Models) -> Batches | None:
        """Return batches of a study that differs only in its shocks, with the same library and memory.

        Returns:
            None if it has FMUs that this study, from which the runs were planned, does not have.

        Raises:
            NotInBatchError: No build has a batch.
        """
        if not {build.fmu for build in models.study.bank.values()} <= {b.fmu for b in self._study.bank.values()}:
            return None
        found = copy(self)
        found._study = models.study
        found._shocks, found.left_out = _data_of(models)
        return found

    @property
    def lanes(self) -> int:
        """Number of setups in a batch."""
        return next(iter(self._drives.values())).lanes

    def runs(self, setups: Iterable[Setup]) -> Iterator[tuple[Setup, dict[str, BatchRun] | None, float]]:
        """Yield each setup with its runs by drive, and their wall time [s]; None if a run did not end regularly."""
        left = iter(setups)
        while several := list(islice(left, _GROUP * self.lanes)):
            began = clock.perf_counter()
            shocks = {setup.index: self._shocks_of(setup) for setup in several}
            lanes = [own for own in shocks.values() if own is not None]
            places = [index for index, own in shocks.items() if own is not None]
            runs = {n: dict(zip(places, b.runs(lanes), strict=True)) for n, b in self._drives.items()} if lanes else {}
            seconds = (clock.perf_counter() - began) / len(several)
            for setup in several:
                own = {name: run for name, found in runs.items() if (run := found.get(setup.index)) is not None}
                yield setup, own if own and len(own) == len(self._drives) else None, seconds

    def has(self, setup: Setup) -> bool:
        """Whether the FMUs of a setup can run in a batch."""
        return self._shocks_of(setup) is not None

    def _shocks_of(self, setup: Setup) -> list[ShockData] | None:
        """Return the shocks of a setup; None if an FMU refuses the parameters of one."""
        found = [self._shocks[build] for build in setup.builds.values()]
        return None if any(shock is None for shock in found) else [shock for shock in found if shock is not None]


def _data_of(models: Models) -> tuple[dict[str, ShockData | None], tuple[str, ...]]:
    """Return the shocks by build, None for those that run through the FMUs, and why a law or FMU has no batch."""
    found: dict[str, ShockData | None] = {}
    reasons: dict[str, None] = {}
    for name, build in models.study.bank.items():
        try:
            found[name] = models.shock_data(build)
        except NotInBatchError as reason:
            found[name], reasons[f"{name}: {reason}"] = None, None
    if len(reasons) == len(found):
        raise NotInBatchError("; ".join(reasons))
    return found, tuple(reasons)
