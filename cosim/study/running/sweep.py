"""Chunks of setups and their files, under digests of what they depend on."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from threading import Event
from types import MappingProxyType
from typing import Any

import numpy as np
from arro3.core import Schema

from cosim.session.session import interrupts_deferred
from cosim.session.setup import RunSetup
from cosim.study.definition import Build, Drive, Setup, Study
from cosim.study.measures import AboveBand, Measure, own_function
from cosim.study.running.coupling import check_setup, disagreement, through_fmus, with_rounding
from cosim.study.running.evaluator import Coupling, Evaluator, Row
from cosim.study.running.leaders import run_leaders
from cosim.study.running.workers import Chunk, Workers
from cosim.study.table import Provenance, StudyResult, result_table, study_schema
from cosim.systems.algorithm import GaussSeidel
from eightpost import __version__, units
from eightpost.array_types import Integers
from eightpost.errors import EightpostError, FileFormatError, InputError, WorkersLostError
from eightpost.files import atomic_path, json_content, sha256_of
from eightpost.machine.car import NotInBatchError
from eightpost.outputs import check_folder, replacing
from eightpost.progress import Progress, beats
from eightpost.schema import checked
from eightpost.signals.parquet_file import Table, joined, read_table, write_table

# ---- Digest of a study ----------------------------------------------------------------------------------------------

#: Entries that do not affect the results: they are applied to the table afterwards.
_AFTER = ("name", "objective", "constraints", "units")


def file_digests(study: Study, known: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
    """Return SHA-256 of every file that a study reads, by its path; those that are known are not read again."""
    return {str(path): known.get(str(path)) or sha256_of(path) for path in file_paths(study)}


def file_paths(study: Study) -> list[Path]:
    """Return every file that a study reads: FMUs, drive files, channel maps, user-defined measures."""
    files = [study.vehicle.fmu, *(build.fmu for build in study.bank.values())]
    for drive in study.drives:
        files += [drive.file, *([drive.channel_map] if drive.channel_map else [])]
    own = [Path(measure.function.rpartition(":")[0]) for measure in study.measures if measure.function]
    return list(dict.fromkeys([*files, *own]))


def study_digest(study: Study, digests: dict[str, str]) -> str:
    """Return the digest of a study; it depends on the contents of files, not on their paths."""
    document = json.loads(study.to_json())
    for name in _AFTER:
        del document[name]
    document = _without_paths(document, digests)
    text = json.dumps({"study": document, "tool": __version__, "batch": BATCH}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _without_paths(value: Any, digests: dict[str, str]) -> Any:
    """Return a value with the digest in place of every path, also in the functions of user-defined measures."""
    if isinstance(value, dict):
        return {key: _without_paths(one, digests) for key, one in value.items()}
    if isinstance(value, list):
        return [_without_paths(one, digests) for one in value]
    if isinstance(value, str):
        file, colon, name = value.rpartition(":")
        return digests.get(value) or (f"{digests[file]}{colon}{name}" if file in digests else value)
    return value


# ---- Chunks of the setups that are left -----------------------------------------------------------------------------

#: Number of setups in a full batch: a chunk has a whole number of them.
BATCH = 8

#: Worker time that a chunk should take [s], and largest number of setups in it: few are lost if a process is killed.
_SECONDS, _LARGEST = 2.0, 1024

#: Number of chunks that every worker should still get, so that all workers end together, and largest growth of a chunk.
_SHARE, _GROWTH = 4, 4


class Cutter:
    """Iterator that cuts the setups that are left into chunks, each when a worker is free for it.

    The first chunks are one batch each. Later ones grow until they take some seconds of worker time, and shrink again
    towards the end. The values of a setup do not depend on its chunk.

    Args:
        indices: Numbers of all setups of the study (S,).
    """

    def __init__(self, indices: Integers, done: Sequence[range], workers: Callable[[], int]) -> None:
        self._indices, self._workers = indices, workers
        self._parts = gaps(done, indices.size)
        self._size, self._cost = BATCH, math.inf
        self.left = sum(map(len, self._parts))
        self._uncut = self.left

    def __iter__(self) -> Iterator[Chunk]:
        return self

    def __next__(self) -> Chunk:
        """Return the next chunk; its number is the position of its first setup."""
        if not self._parts:
            raise StopIteration
        part, size = self._parts[0], self._next_size()
        self._parts[:1] = [part[size:]] if len(part) > size else []
        self._uncut -= len(part[:size])
        return Chunk(part[0], tuple(self._indices[part[0] : part[:size].stop].tolist()))

    def learn(self, rows: Sequence[Row]) -> None:
        """Learn from the rows of a completed chunk how long a setup takes."""
        cost = sum(row["seconds"] for row in rows) / len(rows)
        self._cost = cost if math.isinf(self._cost) else 0.5 * (self._cost + cost)
        self.left -= len(rows)

    def _next_size(self) -> int:
        workers = max(1, self._workers())
        fair = self._uncut / (_SHARE * workers) if workers > 1 else self._uncut
        wanted = min(_SECONDS / max(self._cost, 1e-9), fair, _GROWTH * self._size, _LARGEST)
        self._size = BATCH * max(1, int(wanted) // BATCH)
        return self._size


def gaps(done: Sequence[range], count: int) -> list[range]:
    """Return the positions below `count` that are in none of the ranges, as ranges in increasing order."""
    found, first = list[range](), 0
    for part in (*sorted(done, key=lambda one: one.start), range(count, count)):
        if min(part.start, count) > first:
            found.append(range(first, min(part.start, count)))
        first = max(first, part.stop)
    return found


# ---- Files of a study's completed chunks; each is complete or does not exist ----------------------------------------

_NAME = re.compile(r"chunk_(\d+)_(\d+)\.parquet")


class ChunkFolder:
    """Folder of the completed chunks of one study, and of its coupling.

    The name of a file states the number of the chunk and its number of setups.

    Args:
        digest: Digest of the study; each digest has a folder of its own.
    """

    def __init__(self, folder: Path, digest: str, schema: Schema) -> None:
        self._folder, self._schema = folder / "chunks" / digest[:16], schema

    @property
    def completed(self) -> tuple[range, ...]:
        """Completed chunks, each from its number on as many as it has setups, in increasing order."""
        if not self._folder.is_dir():
            return ()
        found = (_NAME.fullmatch(path.name) for path in self._folder.iterdir())
        pairs = sorted((int(one[1]), int(one[2])) for one in found if one)
        return tuple(range(first, first + count) for first, count in pairs)

    def write(self, chunk: Chunk, rows: Sequence[Row]) -> None:
        """Write the rows of a chunk."""
        write_table(Table.of_rows(rows, self._schema), self._folder / _name(chunk.number, len(rows)))

    def clear(self) -> None:
        """Delete the completed chunks."""
        for chunk in self.completed:
            (self._folder / _name(chunk.start, len(chunk))).unlink(missing_ok=True)

    def tables(self) -> Iterator[Table]:
        """Yield the rows of each completed chunk, in the order of the chunks.

        A setup of two chunks, which two processes ran at the same time, is yielded once.

        Raises:
            FileFormatError: A file is damaged.
        """
        last = -1
        for chunk in self.completed:
            table = self.read(chunk)
            yield table.take(table["setup"] > last)
            last = max(last, int(table["setup"].max(initial=-1)))

    def read(self, chunk: range) -> Table:
        """Return the rows of a completed chunk.

        Raises:
            FileFormatError: The file is damaged, or has not as many rows as its name states.
        """
        path = self._folder / _name(chunk.start, len(chunk))
        try:
            table = read_table(path).select(self._schema)
            if len(table) != len(chunk):
                raise FileFormatError(f"has {len(table)} rows, not {len(chunk)} as its name states", path=path)
        except FileFormatError as error:
            raise FileFormatError(f"{error}; delete the file to run its setups again") from error
        except ValueError as error:
            raise FileFormatError(f"{error}; delete the file to run its setups again", path=path) from error
        return table

    def coupling(self) -> Coupling | None:
        """Return the coupling that was chosen, or None if it was not chosen yet.

        Raises:
            FileFormatError: The file of the coupling is damaged.
        """
        path = self._folder / "coupling.json"
        if not os.path.lexists(path):
            return None
        advice = "delete the file to choose the coupling again"
        return checked(Coupling, json_content(path, finite=False), path=path, advice=advice)

    def keep_coupling(self, coupling: Coupling) -> None:
        """Write the coupling for all later runs of the study."""
        path = self._folder / "coupling.json"  # that of an interrupted study was read, and is completed
        with replacing(path), atomic_path(path) as temporary:
            temporary.write_text(json.dumps(asdict(coupling), indent=2) + "\n", encoding="utf-8")


def _name(number: int, count: int) -> str:
    return f"chunk_{number:07d}_{count}.parquet"


# ---- Checks of a study before any simulation ------------------------------------------------------------------------

#: Signals whose mean is zero in any steady state.
_MOVING = ("m/s", "m/s2", "W")


def _check_study(evaluator: Evaluator) -> None:
    """Raise an error if a study cannot be run."""
    study = evaluator.study
    first = study.space.setup(int(_indices(study)[0]))
    system = evaluator.system(first)
    for corner, build in beats((corner, build) for corner, builds in study.corners.items() for build in builds):
        evaluator.system(Setup(-1, {**first.builds, corner: build}))
    found = evaluator.measure_units
    for measure in study.measures:
        _check_measure(study, measure, found[measure.name])
    _check_objective(study, found)
    for drive in study.drives:
        RunSetup.of(system, evaluator.scenario(drive), GaussSeidel(), study.record_step)


def _indices(study: Study) -> list[int]:
    indices: list[int] = study.space.indices.tolist()
    if not indices:
        raise InputError("the study has no setups: no builds are allowed at all corners of a group in alike")
    return indices


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


# ---- Studies of which all or only requested setups are run, each of them once ---------------------------------------


#: Number of setups from which on a study runs in single precision.
LARGE = 10_000


class Sweep:
    """A checked study that is ready to run, as a whole or setup by setup.

    Completed setups are kept in the folder, so that they are not run again, in this session or another one.

    Args:
        evaluator: Evaluator of the study; None: a new one.

    Raises:
        InputError: The study cannot be run; no simulation was started.
    """

    def __init__(
        self,
        study: Study,
        folder: str | Path,
        evaluator: Evaluator | None = None,
        *,
        digests: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        check_folder(folder)
        self.study, self.folder = study, Path(folder)
        self.evaluator = evaluator = evaluator or Evaluator(study)
        _check_study(evaluator)
        self._digests = file_digests(study, digests)
        self.units, fmus = dict(evaluator.measure_units), evaluator.fmus
        self._guids = {file: fmu.identity for file, fmu in fmus.items()}
        self._models = {file: fmu.validity and fmu.validity.to_json() for file, fmu in fmus.items()}
        self.digest = study_digest(study, self._digests)
        self._schema = study_schema(study, self.units)
        self._above_band: dict[str, AboveBand] | None = None
        self._kept = ChunkFolder(self.folder, self.digest, self._schema)
        self._requested = ChunkFolder(self.folder / "requested", self.digest, self._schema)
        self._rows = dict[int, Row]()  # that were requested or run in this session

    def variant(self, study: Study, folder: Path) -> Sweep:
        """Return the sweep of a study with other shocks or another vehicle, on the FMUs of this one if they are equal.

        Its results do not state how much of each measure is above the band of the vehicle.
        """
        found = Sweep(study, folder, self.evaluator.for_study(study), digests=self._digests)
        found._above_band = {}
        return found

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

    def coupling_of_all(self, workers: Workers) -> Coupling:
        """Return the coupling of a run of all setups: of a large space in single precision, if that is exact enough.

        Raises:
            StepError: No setup could be run.
        """
        found = self.coupling(workers)
        if len(self.study.space) < LARGE or found.machine is None or found.machine.rounding or not self.left:
            return found
        found = with_rounding(self.evaluator, found)
        if found.machine and found.machine.rounding:
            self._kept.keep_coupling(found)
        return found

    def run(self, workers: Workers, coupling: Coupling, progress: Progress | None = None) -> StudyResult:
        """Run the remaining setups and write the result. Ctrl-C lets running chunks finish; the result is then partial.

        Args:
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
                for chunk, rows in workers.rows(self.study, coupling.in_single(), chunks, stopped):
                    self._kept.write(chunk, rows)
                    chunks.learn(rows)
                    tell()
        except WorkersLostError:
            self.collect(coupling, partial=chunks.left > 0)
            raise
        rounding = coupling.machine and coupling.machine.rounding
        result = self.collect(coupling, partial=chunks.left > 0 or rounding is not None)
        if rounding and not chunks.left:
            run_leaders(result, rounding.measures, lambda numbers: self.request(workers, coupling, numbers))
            result = self.collect(coupling, partial=False)
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
            check = check_setup(self.evaluator, setup, coupling.machine).check
        except (NotInBatchError, EightpostError):
            return coupling  # its row is from the FMUs, or states the reason
        if check.agrees:
            found = replace(coupling, machine=replace(coupling.machine, checks=(*coupling.machine.checks, check)))
        else:
            for folder in (self._kept, self._requested):
                folder.clear()
            self._rows.clear()
            self._places.clear()
            found = through_fmus(self.evaluator, disagreement(check))
        self._kept.keep_coupling(found)
        return found

    def collect(self, coupling: Coupling, *, partial: bool) -> StudyResult:
        """Join the completed chunks and the requested rows, which come first, to the result file; return the result."""
        made_by = self._provenance(coupling)
        return StudyResult.join(self.path, self.study, self._tables(), made_by, partial=partial)

    def _tables(self) -> Iterator[Table]:
        again = joined((self._requested.read(chunk) for chunk in self._requested.completed), self._schema)
        for table in self._kept.tables():
            yield self._each_once(again.take(np.isin(again["setup"], table["setup"])), table)

    def _each_once(self, *tables: Table) -> Table:
        """Return the rows of tables by setup; of a setup in several of them, the first row."""
        whole = joined(tables, self._schema)
        return whole.take(np.unique(whole["setup"], return_index=True)[1])

    def request(self, workers: Workers, coupling: Coupling, indices: Sequence[int]) -> StudyResult:
        """Return the results of setups by number; those without one in double precision are run.

        Only their rows are in memory.

        Ctrl-C loses only the setups that are running.
        """
        wanted = list(dict.fromkeys(int(i) for i in indices))
        self._read(index for index in wanted if index in self._places)
        new = [index for index in wanted if index not in self._rows]
        if new:
            found = list[Row]()
            try:
                for _, rows in workers.rows(self.study, coupling, _divided(new, workers.count, BATCH), lambda: False):
                    found += rows
            finally:  # also what was complete when Ctrl-C or a failure ended the runs
                self._keep(found)
        return self._result(coupling, result_table([self._rows[index] for index in wanted], self._schema))

    def everything(self, coupling: Coupling) -> StudyResult:
        """Return all available results, of requests and of an exhaustive run."""
        parts = (kept.read(chunk) for kept in (self._requested, self._kept) for chunk in kept.completed)
        return self._result(coupling, self._each_once(*parts))

    @cached_property
    def _places(self) -> dict[int, tuple[ChunkFolder, range]]:
        """Chunk of each setup with a result in double precision that was not read yet."""
        chosen = self._kept.coupling()
        in_single = chosen is not None and chosen.machine is not None and chosen.machine.rounding is not None
        return {
            number: (kept, chunk)
            for kept in ((self._requested,) if in_single else (self._kept, self._requested))
            for chunk in kept.completed
            for number in kept.read(chunk)["setup"].tolist()
        }

    def _keep(self, found: list[Row]) -> None:
        if found:
            rows = {int(row["setup"]): row for row in sorted(found, key=lambda row: int(row["setup"]))}
            number = max((one.start for one in self._requested.completed), default=-1) + 1
            self._requested.write(Chunk(number, tuple(rows)), list(rows.values()))
            self._rows |= rows

    def _read(self, numbers: Iterable[int]) -> None:
        """Read the rows of setups with a result, of which none is read twice; the files are read one at a time."""
        places = defaultdict[tuple[ChunkFolder, range], set[int]](set)
        for number in numbers:
            places[self._places.pop(number)].add(number)
        for (kept, chunk), wanted in places.items():
            self._rows |= {row["setup"]: row for row in kept.read(chunk).rows() if row["setup"] in wanted}

    def _result(self, coupling: Coupling, table: Table) -> StudyResult:
        partial = len(table) < len(self.study.space)
        return StudyResult(self.study, table, self._provenance(coupling), partial)

    def _provenance(self, coupling: Coupling) -> Provenance:
        if self._above_band is None:
            self._above_band = self.evaluator.above_band(coupling)
        return Provenance(self.digest, self._guids, self._digests, _settings(self.study, coupling), self.units,
                          models=self._models, above_band=self._above_band)  # fmt: skip


def _settings(study: Study, coupling: Coupling) -> dict[str, Any]:
    """Return the settings of runs, in the form that a file has."""
    kept = json.loads(json.dumps(asdict(coupling)))
    return {"coupling": kept, "settling": study.settling, "accuracy": study.accuracy}


def _divided(indices: Sequence[int], workers: int, most: int) -> list[Chunk]:
    """Return setups in chunks of at most a number, so that every worker gets some."""
    size = max(1, min(most, -(-len(indices) // workers)))
    return [Chunk(k, tuple(indices[first : first + size])) for k, first in enumerate(range(0, len(indices), size))]


def run_study(study: Study, folder: str | Path, workers: Workers, progress: Progress | None = None) -> StudyResult:
    """Check a study, choose its coupling, run every setup that is not completed, and write results.parquet.

    A study that is run again with the same folder resumes where it stopped.

    Raises:
        InputError: The study cannot be run; no simulation was started.
        StepError: No setup could be run.
    """
    sweep = Sweep(study, folder)
    return sweep.run(workers, sweep.coupling_of_all(workers), progress)


class Trials:
    """Runs of one study's vehicle and drives with any shocks, which need not be in its bank."""

    def __init__(self, study: Study, units: Mapping[str, str], workers: Workers, coupling: Coupling) -> None:
        self.study, self._units, self._workers, self._coupling = study, dict(units), workers, coupling
        self.count = 0

    def run(self, trials: Sequence[Mapping[str, Build]]) -> StudyResult:
        """Run trials (K,), each a shock by corner; row k of the result is trial k. Failures are reported in the rows.

        Raises:
            InputError: A trial does not have a shock at each corner of the study.
        """
        study, indices = self._described(trials)
        rows, chunks = list[Row](), _divided(indices, 2 * self._workers.count, len(indices))
        for _, found in self._workers.rows(study, self._coupling, chunks, lambda: False):
            rows += found
        self.count += len(rows)
        made_by = Provenance("", {}, {}, _settings(study, self._coupling), self._units)
        return StudyResult(study, result_table(rows, study_schema(study, self._units)), made_by)

    def _described(self, trials: Sequence[Mapping[str, Build]]) -> tuple[Study, list[int]]:
        """Return a study that contains the trials, and their numbers in it."""
        corners = tuple(self.study.corners)
        for trial in trials:
            if set(trial) != set(corners):
                raise InputError(f"a trial needs shocks at {', '.join(corners)}, not at {', '.join(trial) or 'none'}")
        bank = {f"trial {k} {corner}": trial[corner] for k, trial in enumerate(trials) for corner in corners}
        allowed = {corner: tuple(f"trial {k} {corner}" for k in range(len(trials))) for corner in corners}
        study = replace(self.study, bank=bank, corners=allowed, alike=(), baseline={})
        numbers: list[int] = np.ravel_multi_index([np.arange(len(trials))] * len(corners), study.space.radices).tolist()
        return study, numbers
