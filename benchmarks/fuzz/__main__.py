"""Command `python -m benchmarks.fuzz`, which runs a campaign of damaged files for every reader."""

from __future__ import annotations

import argparse
import contextlib
import shutil
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.fuzz.campaign import Failure, Tally, run_campaign, table
from benchmarks.fuzz.readers import Reader, readers
from benchmarks.fuzz.samples import make_samples
from benchmarks.fuzz.worker import in_place, make_mutant, read_mutant


def main() -> int:
    """Run a campaign; exit 1 if any mutant is a defect."""
    given = _arguments()
    chosen = [reader for reader in readers() if not given.reader or any(word in reader.name for word in given.reader)]
    with tempfile.TemporaryDirectory(prefix="fuzz_samples_") as folder:
        samples = Path(folder) / "samples"
        make_samples(samples)
        chosen = [reader for reader in chosen if (samples / reader.sample).exists()]
        if given.replay is not None:
            return _replay(chosen, given.replay, given.seed, samples)
        begun = time.monotonic()
        tallies = run_campaign(chosen, mutants=given.mutants, seed=given.seed, samples=samples, workers=given.workers,
                               progress=_progress)  # fmt: skip
        failures = [failure for tally in tallies for failure in tally.failures]
        for failure in failures:
            _keep(failure, chosen, given.seed, samples, given.output)
    print(table(tallies))
    print(f"seed {given.seed}, {time.monotonic() - begun:.0f} s; defects: {len(failures)}")
    if failures:
        print(
            f"mutants and messages: {given.output}/; to repeat one: --reader NAME --replay NUMBER --seed {given.seed}"
        )
    return int(bool(failures))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="benchmarks.fuzz", description=__doc__)
    parser.add_argument("--mutants", type=int, default=6000, help="Number of mutants over all readers.")
    parser.add_argument("--seed", type=int, default=1, help="Seed of the mutants.")
    parser.add_argument("--reader", action="append", metavar="WORD", help="Only readers with WORD in their name.")
    parser.add_argument("--workers", type=int, default=2, help="Number of parallel processes.")
    parser.add_argument("--replay", type=int, metavar="NUMBER", help="Mutant of the reader to read in this process.")
    parser.add_argument("-o", "--output", type=Path, default=Path("build/fuzz"), help="Folder for mutants that fail.")
    return parser.parse_args()


def _progress(tally: Tally) -> None:
    counts = ", ".join(f"{count} {outcome}" for outcome, count in tally.counts.items())
    print(f"{tally.reader}: {counts} ({tally.seconds:.1f} s)", file=sys.stderr)


def _keep(failure: Failure, chosen: list[Reader], seed: int, samples: Path, output: Path) -> None:
    """Save a failing mutant and its message."""
    reader = next(reader for reader in chosen if reader.name == failure.reader)
    output.mkdir(parents=True, exist_ok=True)
    stem = (
        f"{reader.name.replace(' ', '_').replace(',', '').replace('.', '')}_{seed}_{failure.number}_{failure.outcome}"
    )
    (output / f"{stem}.txt").write_text(failure.text, encoding="utf-8", errors="replace")
    with (
        in_place(samples, reader.sample) as path,
        contextlib.suppress(Exception),
    ):  # a mutant that cannot be created is reported above
        make_mutant(reader, failure.number, seed, path)
        if path.is_file():
            shutil.copy(path, output / f"{stem}{path.suffix}")


def _replay(chosen: list[Reader], number: int, seed: int, samples: Path) -> int:
    for reader in chosen:
        with in_place(samples, reader.sample) as path:
            make_mutant(reader, number, seed, path)
            print(f"{reader.name}: {': '.join(read_mutant(reader, path))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
