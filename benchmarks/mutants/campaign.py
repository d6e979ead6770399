"""A mutation campaign: a random sample of the mutants of all areas, each tried on a copy of the checkout."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from queue import SimpleQueue

from benchmarks.mutants.areas import Area, Equivalent
from benchmarks.mutants.mutant import Mutant, mutants
from benchmarks.mutants.records import Record, append_record, digest_of_tests, read_records
from benchmarks.mutants.trial import Outcome, Tree, Trial, copy_tree

#: Time limit of a trial: multiple of the time without a change, plus a number of seconds.
_SLOWER, _LONGER = 3.0, 20.0
_BASELINE_LIMIT = 600.0


@dataclass(frozen=True)
class Campaign:
    """A mutation campaign and the folder of its records."""

    areas: Sequence[Area]  #: Areas to sample.
    equivalents: Sequence[Equivalent]  #: Mutants that no test can detect; they are counted but not tried.
    folder: Path  #: Folder of the records and of compiled FMUs.
    seed: int  #: Seed of the sample.
    workers: int  #: Number of parallel trials.
    report: Callable[[str], None]  #: Callback that receives a line of text for every new record and other events.

    def run(self, count: int) -> list[Record]:
        """Try a random sample of `count` mutants; return the records, ordered by area.

        Killed mutants of an earlier run are not tried again; survivors are tried again if the tests have changed.

        Raises:
            RuntimeError: The tests of an area fail without a change.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            trees: SimpleQueue[Tree] = SimpleQueue()
            for _ in range(self.workers):
                copy = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mutants-")))
                trees.put(copy_tree(copy, self.folder.resolve() / "cache"))
            # Sources and tests are read in a copy, because the checkout may change meanwhile.
            sample = list(islice(mutants(self.areas, self.seed, copy), count))
            return [
                record
                for area in self.areas
                for record in self._run_area(area, [one for one in sample if one.area == area.name], copy, trees)
            ]

    def _run_area(self, area: Area, sample: list[Mutant], root: Path, trees: SimpleQueue[Tree]) -> list[Record]:
        known, tests = read_records(self._file), digest_of_tests(area, root)
        missing = [mutant for mutant in sample if self._must_try(mutant, known, tests)]
        if missing:
            limit = self._limit(area, trees)
            with ThreadPoolExecutor(self.workers) as pool:
                for record in pool.map(lambda mutant: self._try(area, mutant, limit, tests, trees), missing):
                    known[record.key] = record
        return [self._equivalent(mutant) or known[mutant.key] for mutant in sample]

    @property
    def _file(self) -> Path:
        return self.folder / "records.jsonl"

    def _must_try(self, mutant: Mutant, known: dict[str, Record], tests: str) -> bool:
        if self._equivalent(mutant) is not None:
            return False
        record = known.get(mutant.key)
        return record is None or (record.outcome is Outcome.SURVIVED and record.tests != tests)

    def _equivalent(self, mutant: Mutant) -> Record | None:
        for item in self.equivalents:
            if (item.file, item.line, item.mutant) == (mutant.file, *mutant.lines):
                return Record.of(mutant, Outcome.EQUIVALENT, note=item.reason)
        return None

    def _limit(self, area: Area, trees: SimpleQueue[Tree]) -> float:
        """Return the time limit of a trial [s], from the time of a trial without a change."""
        trial = _on_a_tree(trees, lambda tree: tree.try_mutant(area, None, _BASELINE_LIMIT))
        if trial.outcome is not Outcome.SURVIVED:
            raise RuntimeError(f"{area.name}: its tests fail on the unchanged sources:\n{trial.output}")
        self.report(f"{area.name}: the tests take {trial.seconds:.0f} s")
        return _SLOWER * trial.seconds + _LONGER

    def _try(self, area: Area, mutant: Mutant, limit: float, tests: str, trees: SimpleQueue[Tree]) -> Record:
        trial = _on_a_tree(trees, lambda tree: tree.try_mutant(area, mutant, limit))
        noticed = re.search(r"^FAILED (\S+)|^ERROR (\S+)", trial.output, re.MULTILINE)
        note = "" if noticed is None else noticed[1] or noticed[2]
        record = Record.of(mutant, trial.outcome, seconds=trial.seconds, tests=tests, note=note)
        append_record(self._file, record)
        self.report(f"{record.outcome:9} {record.seconds:5.1f} s  {mutant.file}:{mutant.line}  {mutant.lines[1]}")
        return record


def _on_a_tree(trees: SimpleQueue[Tree], task: Callable[[Tree], Trial]) -> Trial:
    tree = trees.get()
    try:
        return task(tree)
    finally:
        trees.put(tree)
