"""Exhaustive study: every setup is run, on all workers; it resumes where it stopped."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from threading import Event

from cosim.interrupt import interrupts_deferred
from cosim.study.result import Provenance, StudyResult, in_order, study_schema
from cosim.study.running.check import check_study
from cosim.study.running.chunks import ChunkFolder, cut
from cosim.study.running.digest import file_digests, study_digest
from cosim.study.running.evaluator import Coupling, Evaluator
from cosim.study.running.workers import Workers
from cosim.study.study import Study
from eightpost.files import check_output_folder

#: Function that receives the number of completed setups and their total number.
Progress = Callable[[int, int], None]


class Sweep:
    """A checked study that is ready to run.

    Args:
        study: Study to run.
        folder: Output folder for results.parquet and completed chunks.

    Raises:
        InputError: The study cannot be run; no simulation was started.
    """

    def __init__(self, study: Study, folder: str | Path) -> None:
        check_output_folder(folder)
        self.study, self.folder = study, Path(folder)
        evaluator = Evaluator(study)
        check_study(evaluator)
        self._digests = file_digests(study)
        self._units, self._guids = dict(evaluator.measure_units), evaluator.guids
        self._models = evaluator.models
        self.digest = study_digest(study, self._digests)
        self._schema = study_schema(study, self._units)
        self._kept = ChunkFolder(self.folder, self.digest, self._schema)
        self.chunks = cut(study)

    @property
    def path(self) -> Path:
        """Path of the result file."""
        return self.folder / "results.parquet"

    @property
    def left(self) -> int:
        """Number of setups that are not completed."""
        done = self._kept.numbers
        return sum(len(chunk.indices) for chunk in self.chunks if chunk.number not in done)

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

    def run(self, workers: Workers, coupling: Coupling, progress: Progress = lambda _done, _all: None) -> StudyResult:
        """Run the remaining setups and write the result. Ctrl-C lets running chunks finish; the result is then partial.

        Args:
            workers: Workers that run the setups.
            coupling: Coupling of the setups.
            progress: Called after every chunk.
        """
        done, total = self._kept.numbers, len(self.study.space)
        left = [chunk for chunk in self.chunks if chunk.number not in done]
        count = total - self.left
        progress(count, total)
        stop = Event()
        with interrupts_deferred(stop.set):
            for chunk, rows in workers.rows(self.study, coupling, left, stop.is_set):
                self._kept.write(chunk, rows)
                count += len(rows)
                progress(count, total)
        result = self._result(coupling, partial=count < total)
        result.save(self.path)
        return result

    def _result(self, coupling: Coupling, *, partial: bool) -> StudyResult:
        table = in_order(self._kept.table())
        return StudyResult(self.study, table, self._provenance(coupling), partial)

    def _provenance(self, coupling: Coupling) -> Provenance:
        kept = json.loads(json.dumps(asdict(coupling)))  # in the form that a file has
        settings = {"coupling": kept, "settling": self.study.settling, "accuracy": self.study.accuracy}
        return Provenance(self.digest, self._guids, self._digests, settings, self._units, models=self._models)


def run_study(
    study: Study, folder: str | Path, workers: Workers, progress: Progress = lambda _done, _all: None
) -> StudyResult:
    """Check a study, choose its coupling, run every setup that is not completed, and write results.parquet.

    Args:
        study: Study to run.
        folder: Output folder; a study that is run again with the same folder resumes where it stopped.
        workers: Workers that run the setups.
        progress: Function that receives the number of completed setups and their total number.

    Raises:
        InputError: The study cannot be run; no simulation was started.
        StepError: No setup could be run.
    """
    sweep = Sweep(study, folder)
    return sweep.run(workers, sweep.coupling(workers), progress)
