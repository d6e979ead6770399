"""Rows of a study from batches: setups that a batch cannot run, or does not finish, are left to the FMUs."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import islice
from typing import Any, Protocol

import numpy as np

from cosim.components.conversion import to_si
from cosim.components.fmu_component import FmuComponent
from cosim.results.error_estimate import judged_by
from cosim.results.run_data import BondEnergy, Coupled
from cosim.session.automatic import default_scheme
from cosim.session.setup import Setup as SessionSetup
from cosim.study.batch.batch import Batch, BatchResult
from cosim.study.batch.car import CarData, read_car
from cosim.study.batch.library import Library, compiled
from cosim.study.batch.measures import BatchMeasures
from cosim.study.batch.plan import Plan
from cosim.study.batch.reasons import NotInBatchError
from cosim.study.batch.shocks import ShockData, read_shock
from cosim.study.setup import Setup
from cosim.study.statistics import Filtered, sections_of
from cosim.study.study import Build, Drive, Study
from cosim.systems.scenario import Scenario
from cosim.systems.system import System
from eightpost.array_types import Array
from eightpost.errors import EightpostError, FmuError
from eightpost.signals import TimeSeries
from eightpost.workers.pool import heartbeat

#: Modes of a batch: the operations of the FMUs, or fused ones, which change the last bits.
EXACT, FAST = "exact", "fast"


#: Largest number of sections of a filter of fmus/batch/filter.c.
_MOST_SECTIONS = 16

#: Filtered channels (n, R) by name and band [Hz].
_Filtered = dict[tuple[str, tuple[float, float]], Array]


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


@dataclass(frozen=True, slots=True)
class RunSummary:
    """What a row states of one run besides its measures; the names are those of cosim.results.result.Result.

    Attributes:
        share_beyond_fit: Share of time beyond the fit of each shock.
        share_tire_off: Share of time without tire load by channel; None if the static load is unknown.
        energy: Energy through each bond.
        coupled: Local errors of each bond.
    """

    share_beyond_fit: Mapping[str, float]
    share_tire_off: Mapping[str, float | None]
    energy: Mapping[str, BondEnergy]
    coupled: Mapping[str, Coupled]
    share_beyond_settings: Mapping[str, float]
    share_untested_settings: Mapping[str, float]
    ended_by: str = ""
    ended_at: float | None = None


@dataclass(frozen=True, slots=True)
class BatchRun:
    """One setup on one drive.

    Attributes:
        values: Measures by name, in SI.
        summary: Marks and errors.
    """

    values: Mapping[str, float]
    summary: RunSummary


class _DriveBatch:
    """Batches of one drive."""

    def __init__(self, models: Models, drive: Drive, scheme: str, step: float, car: CarData, found: Library) -> None:
        study = models.study
        first = study.space.setup(0)  # any setup: all have the same wiring, and a large space is not enumerated
        setup = SessionSetup.of(models.system(first), models.scenario(drive), default_scheme(scheme), step)
        times = setup.times[setup.recorded == 1]
        self._measures = BatchMeasures(study.measures_of(drive), times, study.settling)
        self._plan = Plan(setup, study.vehicle.name, car, self._measures.quantities, self._measures.series)
        self._units = tuple(to_si(setup.system.output(name))[1] for name in self._measures.series)
        self._batch, self._setup, self._study = Batch(found, self._plan), setup, study
        self.lanes = self._batch.lanes

    def runs(self, shocks: Sequence[Sequence[ShockData]]) -> list[BatchRun | None]:
        """Return the runs of up to as many setups as there are lanes; None for those that did not end regularly."""
        result = self._batch.run(shocks)
        try:
            with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
                values = self._measures.values(result.statistics)
                ends = self._ends(result)
        except EightpostError:
            return [None] * len(shocks)
        filtered = self._filtered(result)
        return [
            self._run(result, values, ends, filtered, k) if result.ended[k] < 0 else None for k in range(len(shocks))
        ]

    def _run(
        self, result: BatchResult, values: Mapping[str, Any], ends: Mapping[str, Any], filtered: _Filtered, k: int
    ) -> BatchRun | None:
        found = {name: float(several[k]) for name, several in values.items()}
        try:
            found |= self._from_series(result, filtered, k)
        except EightpostError:
            return None
        if not all(map(np.isfinite, found.values())):
            return None
        return BatchRun(found, self._summary(result, ends, k))

    def _filtered(self, result: BatchResult) -> _Filtered:
        """Return the channels of measures with a band, filtered (n, R)."""
        rate = TimeSeries(self._plan.rows, np.zeros((0, self._plan.rows.size)), (), ()).sample_rate
        found: _Filtered = {}
        for name, band in {(c, m.band) for m in self._measures.others for c in m.channels if m.band is not None}:
            sections = sections_of(*band, rate)
            if (
                sections is not None
                and self._plan.rows.size > sections.pad
                and sections.rows.shape[0] <= _MOST_SECTIONS
            ):
                found[name, band] = np.ascontiguousarray(self._batch.filtered(name, sections).T)
        return found

    def _from_series(self, result: BatchResult, filtered: _Filtered, k: int) -> dict[str, float]:
        if not self._measures.others:
            return {}
        series = TimeSeries(
            self._plan.rows,
            np.ascontiguousarray(result.series[:, :, k].T),
            self._measures.series,
            self._units,
        )
        run = Filtered(series)
        for (name, band), several in filtered.items():
            run.keep(name, band, several[k])
        return {m.name: m.drawn_from(run, start=self._study.settling) for m in self._measures.others}

    def _ends(self, result: BatchResult) -> dict[str, Any]:
        """Return local errors and spreads of both directions of every bond (2, C, n), as cosim.session.outcome does."""
        time = result.duration or 1.0
        share = self._setup.algorithm.accuracy.share
        variance = result.squares / time - (result.total / time) ** 2
        return {
            "error": (share * np.sqrt(result.defect / time)).tolist(),
            "spread": np.sqrt(np.maximum(variance, 0.0)).tolist(),
        }

    def _summary(self, result: BatchResult, ends: Mapping[str, Any], k: int) -> RunSummary:
        corners = self._plan.corners
        error, spread = ends["error"], ends["spread"]
        keys = [(way, c) for c in range(len(corners)) for way in range(2)]
        scale = judged_by(
            {(corners[c], str(way)): spread[way][c][k] for way, c in keys},
            {(corners[c], str(way)): ("m/s", "N")[way] for way, c in keys},
        )
        coupled = {
            name: Coupled(
                error[0][c][k], spread[0][c][k], error[1][c][k], spread[1][c][k], scale[name, "0"], scale[name, "1"]
            )
            for c, name in enumerate(corners)
        }
        limits = self._setup.limits
        times = [result.beyond[corners.index(w.signal.partition(".")[0]), k] if w not in self._plan.limits
                 else result.watched[self._plan.limits.index(w), k] for w in limits.watched]  # fmt: skip
        shares = limits.shares([*map(float, times), result.settled])
        return RunSummary(
            share_beyond_fit=shares["share_beyond_fit"],
            share_tire_off=shares["share_tire_off"],
            share_beyond_settings=shares["share_beyond_settings"],
            share_untested_settings=shares["share_untested_settings"],
            energy={
                name: BondEnergy(float(result.residual[c, k]), float(result.transferred[c, k]))
                for c, name in enumerate(corners)
            },
            coupled=coupled,
        )


class Batches:
    """Batches of a study at one coupling step.

    Args:
        models: FMUs and scenarios of the study.
        scheme: Coupling scheme.
        step: Coupling step [s].
        mode: EXACT or FAST.

    Attributes:
        left_out: Builds whose setups run through the FMUs, each with the reason.

    Raises:
        NotInBatchError: The study cannot run as a batch; the message is the reason.
    """

    def __init__(self, models: Models, scheme: str, step: float, mode: str = EXACT) -> None:
        self._study = study = models.study
        self._shocks, self.left_out = _shocks(models)
        self._wiring = _wiring(models)
        fmus, vehicle = models.fmus, study.vehicle
        car = read_car(fmus[str(vehicle.fmu)], vehicle.fmu, vehicle.parameters, len(study.corners))
        try:
            found = Library(compiled(car.sizes, fast=mode == FAST))
        except (FmuError, OSError) as error:
            raise NotInBatchError(str(error)) from error
        self._drives = {drive.name: _DriveBatch(models, drive, scheme, step, car, found) for drive in study.drives}

    def for_shocks(self, models: Models) -> Batches | None:
        """Return batches of a study that differs only in its shocks, with the same library and memory.

        Returns:
            None if its first setup has other FMUs than that of this study, from which the runs were planned.

        Raises:
            NotInBatchError: No build has a batch.
        """
        if _wiring(models) != self._wiring:
            return None
        found = copy(self)
        found._study = models.study
        found._shocks, found.left_out = _shocks(models)
        return found

    @property
    def lanes(self) -> int:
        """Number of setups in a batch."""
        return next(iter(self._drives.values())).lanes

    def runs(self, setups: Sequence[Setup]) -> Iterator[tuple[Setup, dict[str, BatchRun] | None, float]]:
        """Yield each setup with its runs by drive, and their wall time [s]; None if a run did not end regularly."""
        left = iter(setups)
        while several := list(islice(left, self.lanes)):
            heartbeat()
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


def _wiring(models: Models) -> tuple[tuple[str, str], ...]:
    """Return the shock FMU at each corner of a study's first setup, from which the runs are planned."""
    study = models.study
    return tuple((corner, str(study.bank[build].fmu)) for corner, build in study.space.setup(0).builds.items())


def _shocks(models: Models) -> tuple[dict[str, ShockData | None], tuple[str, ...]]:
    """Return the shocks by build, None for those that run through the FMUs, and why a law or FMU has no batch.

    Raises:
        NotInBatchError: No build has a batch.
    """
    fmus, bank = models.fmus, models.study.bank
    found: dict[str, ShockData | None] = {}
    reasons: dict[str, None] = {}
    same: dict[Any, ShockData | None] = {}  # corners that are alike have the same shock under different names
    for name, build in bank.items():
        key = (build.fmu, tuple(build.parameters.items()))
        try:
            if key not in same:
                same[key] = _accepted(fmus[str(build.fmu)], build)
            found[name] = same[key]
        except NotInBatchError as reason:
            found[name], reasons[f"{name}: {reason}"] = None, None
    if len(reasons) == len(bank):
        raise NotInBatchError("; ".join(reasons))
    return found, tuple(reasons)


def _accepted(component: FmuComponent, build: Build) -> ShockData | None:
    """Return the data of a shock; None if its FMU refuses its parameters, which every run of it then reports."""
    found = read_shock(component, build.fmu, build.parameters)
    try:
        component.begin(0.0, 1.0, build.parameters)
        component.end_initialization()
    except EightpostError:
        return None
    finally:
        component.finish()
    return found
