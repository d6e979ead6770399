"""Evaluation of setups: coupled runs of a vehicle and the shocks of a setup, reduced to measures, and their errors."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import with_config

from cosim.components.component import Component, to_si
from cosim.components.fmu_component import FmuComponent
from cosim.session.result import Result
from cosim.session.session import Session
from cosim.session.verdict import LARGEST_ERROR
from cosim.study.definition import Build, Drive, Setup, Study, bond_at, check_corners, read_drive
from cosim.study.measures import AboveBand, Filtered, above_band, band_ends
from cosim.study.running.batches import Batches, BatchRun, ErrorModel, Estimator, RunSummary, local_errors
from cosim.study.running.machine import read_shock
from cosim.study.table import DONE, FAILED, StudyResult, error_column
from cosim.systems.algorithm import default_scheme
from cosim.systems.coupling import Scenario
from cosim.systems.system import System
from eightpost.errors import EightpostError, WiringError
from eightpost.machine import NotInBatchError, ShockData
from eightpost.schema import REPORT, checked
from eightpost.signals import TimeSeries
from eightpost.workers.pool import heartbeat

#: One row of a study's table, by column name.
Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Check:
    """Comparison of the machine with the FMUs on one setup, in percent of each signal's standard deviation."""

    setup: int  #: Number of the setup.
    difference: float  #: Largest difference of a bond's velocity or force, or of a tire force.
    machine: float  #: Estimated error of the machine.
    fmus: float  #: Stated coupling error of the run through the FMUs.
    limit: float  #: Largest difference with which both agree.

    @property
    def agrees(self) -> bool:
        """Whether the difference is explained by the errors of both and the accuracy of the study."""
        return self.difference <= self.limit


@dataclass(frozen=True, slots=True)
class Rounding:
    """Largest differences of some setups in single precision from double precision."""

    percent: float  #: Of the compared channels, in percent of the channel's scale.
    measures: Mapping[str, float]  #: Of each measure, in its SI unit.


@dataclass(frozen=True, slots=True)
class MachineCoupling:
    """How the machine runs setups (cosim.study.running.machine)."""

    step: float  #: Step [s].
    #: Model that estimates errors from how far the forces of each run are from the quadratics of a step.
    errors: ErrorModel
    stated_error: float  #: Largest error of the setups on which the step was chosen [%].
    checks: tuple[Check, ...] = ()  #: Comparisons with the FMUs.
    #: Differences of setups in single precision, in which a run of all setups begins; None: it is in double precision.
    rounding: Rounding | None = None
    in_single: bool = False  #: Whether setups run in single precision.

    def of(self, local: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Return the estimated errors, in the precision in which setups run; see `ErrorModel.of`."""
        largest, measures = self.errors.of(local)
        if not self.in_single or self.rounding is None:
            return largest, measures
        return largest + self.rounding.percent, {n: e + self.rounding.measures.get(n, 0.0) for n, e in measures.items()}


@with_config(REPORT)
@dataclass(frozen=True, slots=True)
class Coupling:
    """Coupling of all runs of a study: chosen once, so that setups differ only in their shocks."""

    scheme: str  #: `gauss-seidel` or `implicit`; of runs through the FMUs.
    step: float  #: Coupling step of runs through the FMUs [s].
    #: Model that estimates coupling errors from the local errors of the bonds; None before its calibration.
    errors: ErrorModel | None = None
    stated_error: float = 0.0  #: Largest coupling error of the setups on which the coupling was chosen [%].
    notes: tuple[str, ...] = ()  #: Description of the steps that were compared, and of how the setups are run.
    machine: MachineCoupling | None = None  #: Of setups that the machine runs; None: all run through the FMUs.

    def in_single(self, *, single: bool = True) -> Coupling:
        """Return the coupling of runs in single precision if the study has them, or else in double precision."""
        if self.machine is None:
            return self
        return replace(self, machine=replace(self.machine, in_single=single and self.machine.rounding is not None))


class Evaluator:
    """Evaluator of the setups of one study in this process; an FMU's instance is kept and reset between runs.

    Raises:
        FmuError: An FMU cannot be used.
        InputError: The study's corners are not those of the vehicle.
        DataError: A drive file cannot be read.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        vehicle = study.vehicle
        self._vehicle = FmuComponent(vehicle.fmu, vehicle.name)
        check_corners(study.corners, self._vehicle, vehicle.fmu)
        self._shocks: dict[tuple[str, Path], FmuComponent] = {}
        self._scenarios = {drive.name: self._scenario(drive) for drive in study.drives}
        self._batches: dict[tuple[float, tuple[str, ...], bool, bool], Batches | str] = {}
        self._data: dict[Any, ShockData | None] = {}
        self._base: Evaluator | None = None  # the first one with the same vehicle

    def for_study(self, study: Study) -> Evaluator | None:
        """Return an evaluator of a variant with the same instances; None if the study cannot be one.

        A variant has other shocks, or other parameters of the vehicle. The evaluators share the instances, so they must
        be used one after the other.
        """
        if study == self.study:
            return self
        vehicle = replace(self.study.vehicle, parameters=study.vehicle.parameters)
        shocks = {name: getattr(study, name) for name in ("bank", "corners", "alike", "baseline")}
        if replace(self.study, vehicle=vehicle, **shocks) != study:
            return None
        found, first = copy(self), self._base or self
        found.study, found._batches, found._data = study, {}, {**first._data}
        found._base = first if vehicle == self.study.vehicle else None
        return found

    def system(self, setup: Setup) -> System:
        """Return the coupled system of a setup.

        Raises:
            WiringError: The vehicle lacks a port, or the FMUs do not fit together.
        """
        study, vehicle = self.study, self.study.vehicle
        shocks = {corner: self._shock(corner, build) for corner, build in setup.builds.items()}
        parameters = {corner: study.bank[build].parameters for corner, build in setup.builds.items()}
        components: dict[str, Component] = {vehicle.name: self._vehicle, **shocks}
        return System(
            components=components,
            bonds=tuple(bond_at(self._vehicle, vehicle.name, corner, shock) for corner, shock in shocks.items()),
            constants={f"{vehicle.name}.{name}": value for name, value in vehicle.inputs.items()},
            parameters={name: p for name, p in {vehicle.name: vehicle.parameters, **parameters}.items() if p},
        )

    def scenario(self, drive: Drive, *, extra: Iterable[str] = ()) -> Scenario:
        """Return the scenario of a drive, which records the channels of its measures and `extra`."""
        scenario = self._scenarios[drive.name]
        if drive.stop != scenario.stop:
            scenario = replace(scenario, stop=drive.stop)
        if not (names := tuple(extra)):
            return scenario
        return replace(scenario, record=tuple(dict.fromkeys((*scenario.record, *names))))

    def run(self, setup: Setup, drive: Drive, coupling: Coupling, *, extra: Iterable[str] = ()) -> Result:
        """Run a setup on a drive.

        Raises:
            StepError: An FMU failed, or the coupling diverged.
        """
        system = self.system(setup)
        scenario = self.scenario(drive, extra=extra)
        session = Session(system, scenario, default_scheme(coupling.scheme), coupling.step)
        heartbeat()  # the first run loads its FMUs and the loop, which takes long
        return session.run(progress=heartbeat)

    def row(self, setup: Setup, coupling: Coupling) -> Row:
        """Run a setup on every drive and return its row; failures are reported in the row and not raised."""
        heartbeat()
        began = clock.perf_counter()
        found: Row = {"setup": setup.index, **setup.builds, **dict.fromkeys(m.name for m in self.study.measures)}
        try:
            found |= self._measured(setup, coupling)
        except EightpostError as error:
            found |= {"status": FAILED, "message": str(error), "coupling_error_percent": None, "marks": ""}
        return found | {"seconds": clock.perf_counter() - began}

    def rows(self, setups: Sequence[Setup], coupling: Coupling) -> list[Row]:
        """Return the rows of setups, in their order: from batches if the coupling says so, else one after the other.

        A setup that a batch does not finish regularly is run in double precision, then through the FMUs, which say why.
        """
        batches = self.batches(coupling)
        if batches is None or coupling.machine is None:
            return [self.row(setup, coupling) for setup in setups]
        found = list[Row]()
        for setup, runs, seconds in batches.runs(setups):
            if runs is not None:
                found.append(self._batch_row(setup, coupling.machine, runs, seconds))
            elif coupling.machine.in_single:
                found += self.rows([setup], coupling.in_single(single=False))
            else:
                found.append(self.row(setup, coupling))
        return found

    def batches(self, coupling: Coupling) -> Batches | None:
        """Return the batches of the study at a coupling; None if its setups run through the FMUs."""
        with suppress(NotInBatchError):
            machine = coupling.machine
            return None if machine is None else self.batches_at(machine.step, single=machine.in_single)
        return None

    def batches_at(
        self, step: float, recorded: Sequence[str] = (), *, measured: bool = True, single: bool = False
    ) -> Batches:
        """Return the batches of the study at a step [s], which are set up once.

        Args:
            recorded: Names of channels whose series are wanted.
            measured: Whether the runs have measures.
            single: Whether they are in single precision.

        Raises:
            NotInBatchError: The machine cannot run the study.
        """
        key = (step, tuple(recorded), measured, single)
        if key not in self._batches:
            earlier = self._base._batches.get(key) if self._base else None
            try:
                similar = earlier.for_shocks(self) if isinstance(earlier, Batches) else None
                self._batches[key] = similar or Batches(self, *key[:2], measured=measured, single=single)
            except (NotInBatchError, EightpostError) as reason:
                self._batches[key] = str(reason) or type(reason).__name__
        found = self._batches[key]
        if isinstance(found, str):
            raise NotInBatchError(found)
        return found

    def shock_data(self, build: Build) -> ShockData | None:
        """Return a build as the machine takes it; None if its FMU refuses its parameters, which its runs then report.

        Raises:
            NotInBatchError: The machine cannot run it.
        """
        key = (build.fmu, tuple(build.parameters.items()))
        if key not in self._data:
            component = self.fmus[str(build.fmu)]
            found: ShockData | None = read_shock(component, build.fmu, build.parameters)
            try:
                component.begin(0.0, 1.0, build.parameters)
                component.end_initialization()
            except EightpostError:
                found = None
            finally:
                component.finish()
            self._data[key] = found
        return self._data[key]

    def series(self, setups: Sequence[Setup], coupling: Coupling) -> Iterator[tuple[Setup, dict[str, TimeSeries]]]:
        """Yield setups with the channels of the measures by drive, as the runs of the study have them.

        Raises:
            StepError: An FMU failed, or the coupling diverged.
        """
        recorded = tuple(dict.fromkeys(channel for measure in self.study.measures for channel in measure.channels))
        found: Iterable[tuple[Setup, dict[str, BatchRun] | None, float]] = ((setup, None, 0.0) for setup in setups)
        if coupling.machine is not None:
            with suppress(NotInBatchError, EightpostError):
                found = self.batches_at(coupling.machine.step, recorded, measured=False).runs(setups)
        for setup, runs, _ in found:
            if runs is None:
                yield setup, {d.name: self.run(setup, d, coupling).series for d in self.study.drives}
            else:
                yield setup, {name: run.channels() for name, run in runs.items()}

    def _batch_row(self, setup: Setup, model: Estimator, runs: Mapping[str, BatchRun], seconds: float) -> Row:
        own = (runs[drive.name] for drive in self.study.drives)
        found = (_MeasuredRun(run.values, run.summary, run.estimate(model)) for run in own)
        return {"setup": setup.index, **setup.builds, **self._measured_on(found), "seconds": seconds}

    @cached_property
    def measure_units(self) -> Mapping[str, str]:
        """SI unit of every measure.

        Raises:
            WiringError: A measure names a channel that does not exist.
        """
        system = self.system(self.study.space.setup(int(self.study.space.indices[0])))
        found = {}
        for measure in self.study.measures:
            try:
                channels = [to_si(system.output(name))[1] for name in measure.channels]
            except WiringError as error:
                raise WiringError(f"measure {measure.name!r}: {error}") from error
            found[measure.name] = measure.unit_for(channels[0])
        return found

    @property
    def fmus(self) -> dict[str, FmuComponent]:
        """A component of every FMU, by file."""
        study = self.study
        corner = next(iter(study.corners))
        shocks = {str(build.fmu): self._shock(corner, name) for name, build in study.bank.items()}
        return {str(study.vehicle.fmu): self._vehicle, **shocks}

    def decisive(self, setup: Setup) -> frozenset[str]:
        """Return the channels whose coupling errors are compared: velocities and forces of bonds, tire forces."""
        return self.system(setup).decisive

    def _measured(self, setup: Setup, coupling: Coupling) -> Row:
        found = []
        for drive in self.study.drives:
            result = self.run(setup, drive, coupling)
            if not result.converged:
                return {"status": FAILED, "message": result.notes[0], "coupling_error_percent": None, "marks": ""}
            estimate = coupling.errors.of(local_errors(result)) if coupling.errors else None
            found.append(_MeasuredRun(self.measured(result, drive), result, estimate))
        return self._measured_on(found)

    def _measured_on(self, runs: Iterable[_MeasuredRun]) -> Row:
        """Return the part of a row that states values, marks and errors, from the runs on all drives."""
        values, marks, worst = Row(), list[str](), None
        for drive, run in zip(self.study.drives, runs, strict=True):
            values |= run.values
            where = f"{drive.name}: " if len(self.study.drives) > 1 else ""
            marks += [where + mark for mark in (_marks(run.result) if run.result else ())]
            if run.estimate is not None:
                largest, errors = run.estimate
                worst = max(worst or 0.0, float(largest))
                values |= {error_column(name): errors.get(name) for name in run.values}
        if worst is not None and worst > self.study.accuracy:
            marks.append(f"coupling error {worst:.2g} %")
        return values | {"status": DONE, "message": "", "coupling_error_percent": worst, "marks": "; ".join(marks)}

    def above_band(self, coupling: Coupling) -> dict[str, AboveBand]:
        """Return the power of each measure above the band in which the vehicle was identified, by measure.

        It is that of the baseline, or else of the first setup; empty if the vehicle states no band, or the run fails.
        """
        study, validity = self.study, self._vehicle.validity
        ends = band_ends(validity and validity.to_json(), study.vehicle.name)
        if not ends:
            return {}
        setup = study.baseline_setup or study.space.setup(int(study.space.indices[0]))
        found: dict[str, AboveBand] = {}
        try:
            ((_, series),) = self.series([setup], coupling)
        except EightpostError:
            return {}  # the setup's row states the reason
        for drive in study.drives:
            found |= above_band(Filtered(series[drive.name]), study.measures_of(drive), ends, study.settling)
        return found

    def measured(self, result: Result, drive: Drive) -> dict[str, float]:
        """Return the values of the measures of a run on a drive, in SI."""
        run = Filtered(result.series)
        return {m.name: m.drawn_from(run, start=self.study.settling) for m in self.study.measures_of(drive)}

    def _scenario(self, drive: Drive) -> Scenario:
        channels = [channel for measure in self.study.measures_of(drive) for channel in measure.channels]
        return Scenario(
            stop=drive.stop,
            drive=read_drive(drive),
            targets=drive.targets,
            record=tuple(dict.fromkeys(channels)),
            record_step=self.study.record_step,
            settling=self.study.settling,
            drive_start=drive.start,
        )

    def _shock(self, corner: str, build: str) -> FmuComponent:
        fmu = self.study.bank[build].fmu
        key = (corner, fmu)  # builds that differ in their parameters share an instance
        if key not in self._shocks:
            self._shocks[key] = FmuComponent(fmu, corner)
        return self._shocks[key]


class _MeasuredRun(NamedTuple):
    """A run on one drive."""

    values: Mapping[str, float]  #: Measures by name, in SI.
    result: Result | RunSummary | None  #: Run with marks; None if it has none.
    estimate: tuple[float, Mapping[str, float]] | None  #: Estimated errors, see `ErrorModel.of`; None without a model.


def local_error(result: Result) -> float:
    """Return the largest local error that a bond of a run reports [%]."""
    return max((coupled.percent for coupled in result.coupled.values()), default=0.0)


def _marks(result: Result | RunSummary) -> Iterator[str]:
    """Yield marks of a run: an early end, limits that were exceeded, energy that was gained or lost in the coupling."""
    if result.ended_by:
        yield f"{result.ended_by} ended the simulation at {result.ended_at:g} s"
    limits = {
        "beyond its fitted velocities": result.share_beyond_fit,
        "beyond its measured settings": result.share_beyond_settings,
        "at untested settings": result.share_untested_settings,
    }
    for words, shares in limits.items():
        yield from (f"{shock} {words} {_percent(share)} of the time" for shock, share in shares.items() if share > 0.0)
    for tire, lost in result.share_tire_off.items():
        if lost:
            yield f"{tire.removesuffix('.tire_force')} tire off the ground {_percent(lost)} of the time"
    for bond, coupled in result.coupled.items():
        if coupled.percent > LARGEST_ERROR:
            yield f"{bond}: local coupling error {_percent(0.01 * coupled.percent)}: not usable"
    for bond, energy in result.energy.items():
        if not energy.acceptable:
            yield f"{bond}: the coupling makes or loses {energy.relative:.0%} of its energy"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


# ---- Time traces of setups ------------------------------------------------------------------------------------------


def coupling_of(result: StudyResult) -> Coupling:
    """Return the coupling of a study's runs."""
    return checked(Coupling, result.provenance.settings["coupling"], place="coupling", advice="run the study again")


def traces(result: StudyResult, setups: Iterable[int], evaluator: Evaluator | None = None) -> dict[int, TimeSeries]:
    """Return the time series of the measures' channels on the first drive by setup, as those of the study.

    Args:
        result: Result of the study; its FMUs and drive files must still exist at their paths.
        evaluator: Evaluator of the study; None: a new one.

    Raises:
        InputError: A file does not exist any more, or there is no such setup.
        StepError: An FMU failed.
    """
    evaluator = evaluator or Evaluator(result.study)
    coupling, drive = coupling_of(result), result.study.drives[0]
    space = result.study.space
    chosen = [space.setup(index) for index in setups]
    return {setup.index: series[drive.name] for setup, series in evaluator.series(chosen, coupling)}
