"""Command `python -m benchmarks.fuzz`, which runs a campaign of damaged files for every reader."""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.fuzz.readers import Reader, readers
from benchmarks.fuzz.samples import make_samples
from benchmarks.fuzz.worker import CRASH, HANG, OUTCOMES, SOUND, in_place, make_mutant, read_mutant, work
from benchmarks.table import markdown, parser_of

#: Time limits for one mutant, and for a worker's start including imports [s].
_LONGEST, _START = 60.0, 120.0
#: Number of mutants of a reader per worker.
_BATCH = 250

_SPAWNED = multiprocessing.get_context("spawn")

#: Name of a reader, number of its first mutant, and number after its last mutant.
Job = tuple[str, int, int]


@dataclass(frozen=True)
class Failure:
    """A mutant that was neither read nor rejected with a message that names the file."""

    reader: str
    number: int
    outcome: str
    text: str


@dataclass
class Tally:
    """The outcomes of the mutants of one reader."""

    reader: str
    counts: Counter[str] = field(default_factory=Counter)
    failures: list[Failure] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def mutants(self) -> int:
        """Number of mutants that were tried."""
        return sum(self.counts.values())

    def add(self, number: int, outcome: str, text: str, seconds: float) -> None:
        """Count a mutant."""
        self.counts[outcome] += 1
        self.seconds += seconds
        if outcome not in SOUND:
            self.failures.append(Failure(self.reader, number, outcome, text))


def run_campaign(
    chosen: Sequence[Reader], *, mutants: int, seed: int, samples: Path, workers: int = 1, together: bool = False
) -> list[Tally]:
    """Try mutants on readers.

    Args:
        chosen: Readers to try.
        mutants: Number of mutants of all readers together; each reader has at least one.
        seed: Seed of the mutants.
        samples: Folder of the valid samples.
        workers: Number of parallel processes.
        together: Whether one process tries all readers, which saves most of the time for few mutants.
    """
    whole = sum(reader.share for reader in chosen)
    counts = {reader.name: max(1, round(mutants * reader.share / whole)) for reader in chosen}
    jobs = [
        [(name, first, min(first + _BATCH, count)) for first in range(0, count, _BATCH)]
        for name, count in counts.items()
    ]
    groups = [list(itertools.chain.from_iterable(jobs))] if together else jobs
    tallies = {name: Tally(name) for name in counts}

    def run(group: list[Job]) -> None:
        for name, *outcome in _outcomes(group, seed, samples):
            tally = tallies[name]
            tally.add(*outcome)
            if tally.mutants == counts[name]:
                told = ", ".join(f"{count} {outcome}" for outcome, count in tally.counts.items())
                print(f"{name}: {told} ({tally.seconds:.1f} s)", file=sys.stderr)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(run, groups))
    return list(tallies.values())


def _outcomes(jobs: list[Job], seed: int, samples: Path) -> Iterator[tuple[str, int, str, str, float]]:
    """Yield reader, number, outcome, text and processor time of each mutant; a worker that crashes is replaced."""
    while jobs:
        begun: tuple[str, int] | None = None
        receiver, sender = _SPAWNED.Pipe(duplex=False)
        with tempfile.NamedTemporaryFile() as printed:
            process = _SPAWNED.Process(target=work, args=(sender, printed.name, samples, seed, jobs))
            process.start()
            sender.close()
            outcome, patience = HANG, _START
            try:
                while receiver.poll(patience):
                    message, patience = receiver.recv(), _LONGEST
                    begun = message if len(message) == 2 else None
                    if begun is None:
                        yield message
                        jobs = _after(jobs, *message[:2])
            except EOFError:
                outcome = CRASH
                process.join(_LONGEST)
            finally:
                ended = process.exitcode
                process.kill()
                process.join()
                receiver.close()
            how = f"exit code {ended}\n{Path(printed.name).read_text(encoding='utf-8', errors='replace')[-4000:]}"
        how = f"no answer within {patience:g} s" if outcome == HANG else how
        if begun is not None:
            yield *begun, outcome, how, 0.0
            jobs = _after(jobs, *begun)
        elif jobs:
            raise RuntimeError(f"{jobs[0][0]}: the worker cannot read the valid sample: {how}")


def _after(jobs: list[Job], name: str, number: int) -> list[Job]:
    """Return the remaining jobs after a mutant."""
    place = next(k for k, (reader, first, last) in enumerate(jobs) if reader == name and first <= number < last)
    _, _, last = jobs[place]
    rest = [(name, number + 1, last)] if number + 1 < last else []
    return rest + jobs[place + 1 :]


def table(tallies: Sequence[Tally]) -> str:
    """Return the tallies as a Markdown table."""
    total = Tally("all", sum((tally.counts for tally in tallies), Counter()))
    rows = [(t.reader, str(t.mutants), *(str(t.counts[o]) for o in OUTCOMES)) for t in (*tallies, total)]
    return markdown(("reader", "mutants", *OUTCOMES), rows)


def main() -> int:
    """Run a campaign; exit 1 if any mutant is a defect."""
    parser = parser_of(__doc__)
    parser.add_argument("--mutants", type=int, default=6000, help="Number of mutants over all readers.")
    parser.add_argument("--seed", type=int, default=1, help="Seed of the mutants.")
    parser.add_argument("--reader", action="append", metavar="WORD", help="Only readers with WORD in their name.")
    parser.add_argument("--workers", type=int, default=2, help="Number of parallel processes.")
    parser.add_argument("--replay", type=int, metavar="NUMBER", help="Mutant of the reader to read in this process.")
    parser.add_argument("-o", "--output", type=Path, default=Path("build/fuzz"), help="Folder for mutants that fail.")
    given = parser.parse_args()
    chosen = [reader for reader in readers() if not given.reader or any(word in reader.name for word in given.reader)]
    with tempfile.TemporaryDirectory(prefix="fuzz_samples_") as folder:
        samples = Path(folder) / "samples"
        make_samples(samples)
        chosen = [reader for reader in chosen if (samples / reader.sample).exists()]
        if given.replay is not None:
            for reader in chosen:
                with in_place(samples, reader.sample) as path:
                    make_mutant(reader, given.replay, given.seed, path)
                    print(f"{reader.name}: {': '.join(read_mutant(reader, path))}")
            return 0
        begun = time.monotonic()
        tallies = run_campaign(chosen, mutants=given.mutants, seed=given.seed, samples=samples, workers=given.workers)
        failures = [failure for tally in tallies for failure in tally.failures]
        for failure in failures:
            _keep(failure, chosen, given.seed, samples, given.output)
    print(table(tallies))
    print(f"seed {given.seed}, {time.monotonic() - begun:.0f} s; defects: {len(failures)}")
    if failures:
        print(f"mutants, messages: {given.output}/; to repeat one: --reader NAME --replay NUMBER --seed {given.seed}")
    return int(bool(failures))


def _keep(failure: Failure, chosen: list[Reader], seed: int, samples: Path, output: Path) -> None:
    """Save a failing mutant and its message."""
    reader = next(reader for reader in chosen if reader.name == failure.reader)
    output.mkdir(parents=True, exist_ok=True)
    stem = f"{re.sub(r'[^a-z0-9]+', '_', reader.name.lower())}_{seed}_{failure.number}_{failure.outcome}"
    (output / f"{stem}.txt").write_text(failure.text, encoding="utf-8", errors="replace")
    # A mutant that cannot be created is reported above.
    with in_place(samples, reader.sample) as path, contextlib.suppress(Exception):
        make_mutant(reader, failure.number, seed, path)
        if path.is_file():
            shutil.copy(path, output / f"{stem}{path.suffix}")


if __name__ == "__main__":
    sys.exit(main())
