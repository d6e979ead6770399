"""Mutation testing of the product.

    python -m benchmarks.mutants [--count N] [--seed S] [--areas NAMES] [--workers N] [--folder FOLDER]

A mutant is a source with one operator, sign, bound or constant changed. Mutants are sampled at random in the sources of
all areas, and the tests of the area (areas.toml) are run on a copy of the checkout: a mutant is killed if one of them
fails. Mutants of equivalent.toml give the same results as the source, so no test can detect them; they are counted
separately. Records are kept in the folder: the same command resumes the campaign, and tries survivors again if the
tests have changed. Prints Markdown, which is also written to FOLDER/report.md. The exit code is 1 if fewer than 90 %
of the mutants are killed.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from queue import SimpleQueue

from benchmarks.mutants.area_tests import Area, Equivalent, read_areas, read_equivalents
from benchmarks.mutants.mutant import Mutant, mutants
from benchmarks.mutants.trial import (
    Outcome,
    Record,
    Tree,
    Trial,
    append_record,
    copy_tree,
    digest_of_tests,
    read_records,
)
from benchmarks.table import markdown, parser_of

_HEADS = ("area", "tried", "killed", "of these by time limit", "survived", "killed [%]", "equivalent", "invalid")
_NOTICED = (Outcome.KILLED, Outcome.TIMEOUT)
#: Required share of killed mutants.
_LEAST = 0.9


def killed_share(records: Sequence[Record]) -> float:
    """Return the share of killed mutants [1] among those that a test can detect; 1 if the list is empty."""
    tried = [record.outcome for record in records if record.outcome in (*_NOTICED, Outcome.SURVIVED)]
    return sum(outcome in _NOTICED for outcome in tried) / len(tried) if tried else 1.0


def report(records: Sequence[Record], seed: int) -> str:
    """Return the report of a campaign."""
    areas = dict.fromkeys(record.area for record in records)
    rows = [_row(area, [record for record in records if record.area == area]) for area in areas]
    parts = [f"Mutants, seed {seed}:", markdown(_HEADS, [*rows, _row("all", records)])]
    parts += [
        f"Survived: {record.file}:{record.line} ({record.area})\n\n```diff\n{record.diff}\n```"
        for record in records
        if record.outcome is Outcome.SURVIVED
    ]
    return "\n\n".join(parts) + "\n"


def _row(name: str, records: Sequence[Record]) -> list[str]:
    count = {outcome: sum(record.outcome is outcome for record in records) for outcome in Outcome}
    killed, survived = sum(count[outcome] for outcome in _NOTICED), count[Outcome.SURVIVED]
    cells = (name, killed + survived, killed, count[Outcome.TIMEOUT], survived, f"{100.0 * killed_share(records):.1f}",
             count[Outcome.EQUIVALENT], count[Outcome.INVALID])  # fmt: skip
    return [str(cell) for cell in cells]


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
        known, tests = read_records(self.folder), digest_of_tests(area, root)
        missing = [mutant for mutant in sample if self._must_try(mutant, known, tests)]
        if missing:
            limit = self._limit(area, trees)
            with ThreadPoolExecutor(self.workers) as pool:
                for record in pool.map(lambda mutant: self._try(area, mutant, limit, tests, trees), missing):
                    known[record.key] = record
        return [self._equivalent(mutant) or known[mutant.key] for mutant in sample]

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
        trial = _tried(trees, area, None, _BASELINE_LIMIT)
        if trial.outcome is not Outcome.SURVIVED:
            raise RuntimeError(f"{area.name}: its tests fail on the unchanged sources:\n{trial.output}")
        self.report(f"{area.name}: the tests take {trial.seconds:.0f} s")
        return _SLOWER * trial.seconds + _LONGER

    def _try(self, area: Area, mutant: Mutant, limit: float, tests: str, trees: SimpleQueue[Tree]) -> Record:
        trial = _tried(trees, area, mutant, limit)
        noticed = re.search(r"^FAILED (\S+)|^ERROR (\S+)", trial.output, re.MULTILINE)
        note = "" if noticed is None else noticed[1] or noticed[2]
        record = Record.of(mutant, trial.outcome, seconds=trial.seconds, tests=tests, note=note)
        append_record(self.folder, record)
        self.report(f"{record.outcome:9} {record.seconds:5.1f} s  {mutant.file}:{mutant.line}  {mutant.lines[1]}")
        return record


def _tried(trees: SimpleQueue[Tree], area: Area, mutant: Mutant | None, limit: float) -> Trial:
    tree = trees.get()
    try:
        return tree.try_mutant(area, mutant, limit)
    finally:
        trees.put(tree)


def main() -> int:
    """Run a campaign."""
    areas = read_areas()
    names = [area.name for area in areas]
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=200, help="number of mutants in all areas (default 200)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the sample (default 1)")
    parser.add_argument("--areas", nargs="+", choices=names, default=names, help="areas to sample (default all)")
    parser.add_argument("--workers", type=int, default=2, help="number of parallel trials (default 2)")
    parser.add_argument("--folder", type=Path, default=Path("out/mutants"), help="records (default out/mutants)")
    options = parser.parse_args()
    chosen = [area for area in areas if area.name in options.areas]
    tell = partial(print, file=sys.stderr, flush=True)
    campaign = Campaign(chosen, read_equivalents(), options.folder, options.seed, options.workers, tell)
    found = campaign.run(options.count)
    text = report(found, options.seed)
    (options.folder / "report.md").write_text(text, encoding="utf-8")
    print(text)
    return 0 if killed_share(found) >= _LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
