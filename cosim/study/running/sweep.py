"""Sweep over setups: stored rows, resumed studies, requested setups, checks by finer runs."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from threading import Event

import numpy as np
import pyarrow as pa

from cosim.session.session import interrupts_deferred
from cosim.session.setup import Setup as SessionSetup
from cosim.study.measures import AboveBand, Measure, own_function
from cosim.study.result import StudyResult
from cosim.study.running.choose_machine import check_setup, disagreement, through_fmus
from cosim.study.running.chunks import BATCH, ChunkFolder, Cutter, file_digests, gaps, study_digest
from cosim.study.running.evaluator import Coupling, Evaluator, Row
from cosim.study.running.workers import Chunk, Workers
from cosim.study.study import Drive, Setup, Study
from cosim.study.table import Provenance, result_table, study_schema
from cosim.systems.algorithm import GaussSeidel
from eightpost import units
from eightpost.errors import EightpostError, InputError, WorkersLostError
from eightpost.machine.reasons import NotInBatchError
from eightpost.outputs import check_folder
from eightpost.progress import Progress, beats

# ---- Checks of a study before any simulation ------------------------------------------------------------------------

#: Signals whose mean is zero in any steady state.
_MOVING = ("m/s", "m/s2", "W")


def _check_study(evaluator: Evaluator) -> None:
    """Raise an error if a study cannot be run.

    Raises:
        FmuError: An FMU cannot be used.
        WiringError: A build does not fit a corner, or a channel or parameter does not exist.
        InputError: A measure, its unit or its window is invalid.
    """
    study = evaluator.study
    first = study.space.setup(int(_indices(study)[0]))
    system = evaluator.system(first)
    for setup in beats(_every_build(study, first)):
        evaluator.system(setup)
    found = evaluator.measure_units
    for measure in study.measures:
        _check_measure(study, measure, found[measure.name])
    _check_objective(study, found)
    for drive in study.drives:
        SessionSetup.of(system, evaluator.scenario(drive), GaussSeidel(), study.record_step)


def _indices(study: Study) -> list[int]:
    indices: list[int] = study.space.indices.tolist()
    if not indices:
        raise InputError("the study has no setups: no builds are allowed at all corners of a group in alike")
    return indices


def _every_build(study: Study, first: Setup) -> list[Setup]:
    """Return setups in which every build is once at every corner where it is allowed."""
    return [Setup(-1, {**first.builds, corner: build}) for corner, builds in study.corners.items() for build in builds]


def _check_measure(study: Study, measure: Measure, unit: str) -> None:
    what = f"measure {measure.name!r}"
    if measure.display and not (units.is_unit(measure.display) and units.compatible(measure.display, unit)):
        raise InputError(
            f"{what}: its unit is {unit}, which cannot be converted to the display unit {measure.display!r}"
        )
    if measure.function:
        own_function(measure.function)
    elif measure.absolute and not study.vehicle.means_trusted and unit not in _MOVING:
        raise InputError(
            f"{what}: its {measure.statistic} depends on the mean, and {study.vehicle.fmu.name} has no trusted gain at "
            "0 Hz (means_trusted = false); use rms, peak or range, or a band that begins above 0 Hz"
        )
    for drive in study.drives:
        if measure in study.measures_of(drive):
            _check_window(study, measure, drive)


def _check_window(study: Study, measure: Measure, drive: Drive) -> None:
    rate = 1.0 / study.record_step
    if measure.section and not (study.settling <= measure.section[0] and measure.section[1] <= drive.stop + 1e-9):
        raise InputError(
            f"measure {measure.name!r}: its section {measure.section[0]:g} to {measure.section[1]:g} s must lie "
            f"between the settling time and the stop, {study.settling:g} to {drive.stop:g} s"
        )
    if measure.band and (measure.band[0] >= 0.5 * rate or rate * 0.5 <= measure.band[1] < float("inf")):
        raise InputError(
            f"measure {measure.name!r}: the band {measure.band[0]:g} to {measure.band[1]:g} Hz must be below half the "
            f"sample rate of {rate:g} Hz; use a smaller record_step"
        )


def _check_objective(study: Study, found: Mapping[str, str]) -> None:
    for term in study.objective:
        unit = found[term.measure]
        if term.unit and not (units.is_unit(term.unit) and units.compatible(term.unit, unit)):
            raise InputError(
                f"objective: the unit of {term.measure!r} is {unit}, which cannot be converted to {term.unit!r}, the "
                "unit of its weight"
            )


# ---- Exhaustive study -----------------------------------------------------------------------------------------------


class Sweep:
    """A checked study that is ready to run.

    Args:
        study: Study to run.
        folder: Output folder for results.parquet and completed chunks.

    Raises:
        InputError: The study cannot be run; no simulation was started.
    """

    def __init__(self, study: Study, folder: str | Path) -> None:
        check_folder(folder)
        self.study, self.folder = study, Path(folder)
        self._evaluator = evaluator = Evaluator(study)
        _check_study(evaluator)
        self._digests = file_digests(study)
        self._units, fmus = dict(evaluator.measure_units), evaluator.fmus
        self._guids = {file: fmu.identity for file, fmu in fmus.items()}
        self._models = {file: fmu.validity and fmu.validity.to_json() for file, fmu in fmus.items()}
        self.digest = study_digest(study, self._digests)
        self._schema = study_schema(study, self._units)
        self._above_band: dict[str, AboveBand] | None = None
        self._kept = ChunkFolder(self.folder, self.digest, self._schema)

    @property
    def path(self) -> Path:
        """Path of the result file."""
        return self.folder / "results.parquet"

    @property
    def left(self) -> int:
        """Number of setups that are not completed."""
        return sum(map(len, gaps(self._kept.completed, len(self.study.space))))

    def coupling(self, workers: Workers) -> Coupling:
        """Return the coupling that was chosen before, or choose it.

        Raises:
            StepError: No setup could be run.
        """
        found = self._kept.coupling()
        if found is None:
            found = workers.choose(self.study)
            self._kept.keep_coupling(found)
        return found

    def run(self, workers: Workers, coupling: Coupling, progress: Progress | None = None) -> StudyResult:
        """Run the remaining setups and write the result. Ctrl-C lets running chunks finish; the result is then partial.

        If the workers are lost, the result is partial, too.

        Args:
            workers: Workers that run the setups.
            coupling: Coupling of the setups.
            progress: Callback that receives the number of completed setups and their total number, several times per
                second.

        Raises:
            WorkersLostError: The workers have ended; the partial result was written.
        """
        indices = self.study.space.indices
        chunks = Cutter(indices, self._kept.completed, lambda: workers.count)
        stop = Event()

        def tell() -> None:
            if progress:
                progress(indices.size - chunks.left, indices.size)

        def stopped() -> bool:
            tell()  # the workers ask several times per second
            return stop.is_set()

        tell()
        try:
            with interrupts_deferred(stop.set):
                for chunk, rows in workers.rows(self.study, coupling, chunks, stopped):
                    self._kept.write(chunk, rows)
                    chunks.learn(rows)
                    tell()
        except WorkersLostError:
            self.collect(coupling, partial=chunks.left > 0)
            raise
        result = self.collect(coupling, partial=chunks.left > 0)
        compared = coupling if result.partial else self.compare_best(result, coupling)
        if compared.machine is None and coupling.machine is not None:
            return self.run(workers, compared, progress)
        return result if compared is coupling else self.collect(compared, partial=False)

    def compare_best(self, result: StudyResult, coupling: Coupling) -> Coupling:
        """Compare the best setup of a result with a run through the FMUs, and keep the comparison.

        Returns:
            The coupling with the comparison. If the machine does not agree, that of runs through the FMUs; completed
            setups are then deleted, to be run again.
        """
        best = result.ranking()[:1]
        if coupling.machine is None or not best.size:
            return coupling
        setup = result.setup(int(best[0]))
        if any(check.setup == setup.index for check in coupling.machine.checks):
            return coupling
        try:
            check = check_setup(self._evaluator, setup, coupling.machine).check
        except (NotInBatchError, EightpostError):
            return coupling  # its row is from the FMUs, or states the reason
        if check.agrees:
            found = replace(coupling, machine=replace(coupling.machine, checks=(*coupling.machine.checks, check)))
        else:
            self._clear()
            found = through_fmus(self._evaluator, disagreement(check))
        self._kept.keep_coupling(found)
        return found

    def _clear(self) -> None:
        self._kept.clear()

    def collect(self, coupling: Coupling, *, partial: bool) -> StudyResult:
        """Join the completed chunks to the result file, some thousands of rows at a time, and return the result.

        Args:
            coupling: Coupling of the setups.
            partial: Whether setups are missing.
        """
        made_by = self._provenance(coupling)
        return StudyResult.join(self.path, self.study, self._kept.tables(), made_by, partial=partial)

    def _provenance(self, coupling: Coupling) -> Provenance:
        kept = json.loads(json.dumps(asdict(coupling)))  # in the form that a file has
        settings = {"coupling": kept, "settling": self.study.settling, "accuracy": self.study.accuracy}
        if self._above_band is None:
            self._above_band = self._evaluator.above_band(coupling)
        return Provenance(self.digest, self._guids, self._digests, settings, self._units,
                          models=self._models, above_band=self._above_band)  # fmt: skip


def run_study(study: Study, folder: str | Path, workers: Workers, progress: Progress | None = None) -> StudyResult:
    """Check a study, choose its coupling, run every setup that is not completed, and write results.parquet.

    Args:
        study: Study to run.
        folder: Output folder; a study that is run again with the same folder resumes where it stopped.
        workers: Workers that run the setups.
        progress: Callback that receives the number of completed setups and their total number.

    Raises:
        InputError: The study cannot be run; no simulation was started.
        StepError: No setup could be run.
    """
    sweep = Sweep(study, folder)
    return sweep.run(workers, sweep.coupling(workers), progress)


# ---- Studies of which only requested setups are run, each of them once ----------------------------------------------


class Requested(Sweep):
    """A checked study that runs setups on request.

    Results of an exhaustive run in the same folder are used, and the results of requests are stored there, so that no
    setup is run again, in this session or another one. Only the rows of requested setups are in memory. Ctrl-C loses
    only the setups that are running.

    Args:
        study: Study to run.
        folder: Output folder, with the completed runs.

    Raises:
        InputError: The study cannot be run; no simulation was started.
    """

    def __init__(self, study: Study, folder: str | Path) -> None:
        super().__init__(study, folder)
        self._requested = ChunkFolder(self.folder / "requested", self.digest, self._schema)
        self._batches = max((one.start for one in self._requested.completed), default=-1) + 1
        self._rows = dict[int, Row]()  # that were requested or run in this session
        self._places: dict[int, tuple[ChunkFolder, range]] = {
            number: (kept, chunk)
            for kept in (self._kept, self._requested)
            for chunk, numbers in kept.numbers()
            for number in numbers.tolist()
        }

    def request(self, workers: Workers, coupling: Coupling, indices: Sequence[int]) -> StudyResult:
        """Return the results of setups by number; setups without a result are run.

        Args:
            workers: Workers that run the setups.
            coupling: Coupling of the setups.
            indices: Numbers of the setups.
        """
        wanted = list(dict.fromkeys(int(i) for i in indices))
        self._read(index for index in wanted if index in self._places)
        new = [index for index in wanted if index not in self._rows]
        if new:
            size = max(1, min(BATCH, -(-len(new) // workers.count)))  # every worker gets some
            groups = [Chunk(k, tuple(new[first : first + size])) for k, first in enumerate(range(0, len(new), size))]
            found = list[Row]()
            try:
                for _, rows in workers.rows(self.study, coupling, groups, lambda: False):
                    found += rows
            finally:  # also what was complete when Ctrl-C or a failure ended the runs
                self._keep(found)
        return self._result(coupling, result_table([self._rows[index] for index in wanted], self._schema))

    def _clear(self) -> None:
        for folder in (self._kept, self._requested):
            folder.clear()
        self._rows.clear()
        self._places.clear()

    def _keep(self, found: list[Row]) -> None:
        if not found:
            return
        rows = {int(row["setup"]): row for row in sorted(found, key=lambda row: int(row["setup"]))}
        self._requested.write(Chunk(self._batches, tuple(rows)), list(rows.values()))
        self._batches += 1
        self._rows |= rows

    def everything(self, coupling: Coupling) -> StudyResult:
        """Return all available results, including those of an exhaustive run."""
        whole = pa.concat_tables([self._kept.table(), self._requested.table()])
        _, first = np.unique(whole["setup"].to_numpy(), return_index=True)  # a setup may be in both
        return self._result(coupling, whole.take(pa.array(first)))

    def _read(self, numbers: Iterable[int]) -> None:
        """Read the rows of setups with a result, of which none is read twice; the files are read one at a time."""
        places = defaultdict[tuple[ChunkFolder, range], set[int]](set)
        for number in numbers:
            places[self._places.pop(number)].add(number)
        for (kept, chunk), wanted in places.items():
            self._rows |= {row["setup"]: row for row in kept.rows(chunk) if row["setup"] in wanted}

    def _result(self, coupling: Coupling, table: pa.Table) -> StudyResult:
        partial = table.num_rows < len(self.study.space)
        return StudyResult(self.study, table, self._provenance(coupling), partial)
