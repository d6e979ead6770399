"""Benchmark of the start-up time of commands: processor time of help texts and short runs, vs an earlier version.

    python -m benchmarks.startup [--against COMMIT] [--repeat 7] [--first 1] [--json FILE]

Both versions run alternately with the same Python and packages, each on FMUs that it built from the examples. A *first*
run finds no cached machine code; later runs use that of the first. Processor time includes all child processes of a
command; it is longer on a busy machine, so the ratio is what counts. Prints Markdown. The exit code is 1 if the first
run takes more than 40 % of the time of the earlier version, a later run more than half, or a help text more than twice
the time of `eightpost --help`. Requires git, and Linux or macOS.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.table import number
from eightpost.__main__ import VERBS

ROOT = Path(__file__).resolve().parents[1]
BEFORE, NOW = "before", "now"
RUN = ("run", "examples/seven_dof.toml", "-o", "out")
HELPS = {f"eightpost {verb} --help": (verb, "--help") for verb in VERBS}
HELP, FIRST, LATER = "eightpost --help", "first eightpost run", "later eightpost run"

#: Largest share of the earlier version's time, and largest multiple of `eightpost --help`.
LIMITS = {FIRST: 0.4, LATER: 0.5}
HELP_LIMIT = 2.0


@dataclass(frozen=True)
class Times:
    """Processor times [s] of one command, per version."""

    before: list[float] = field(default_factory=list)  #: Times of the earlier version.
    now: list[float] = field(default_factory=list)  #: Times of this version.

    @property
    def ratio(self) -> float:
        """Ratio of the minimum times, now to before."""
        return min(self.now) / min(self.before)


@dataclass(frozen=True)
class Version:
    """A checkout, and a folder with the examples and the FMUs that it built from them."""

    checkout: Path
    folder: Path

    def seconds(self, words: Sequence[str], cache: Path) -> float:
        """Run a command and return its processor time [s]."""
        before = _children()
        self.run(words, cache)
        return _children() - before

    def run(self, words: Sequence[str], cache: Path) -> None:
        """Run a command."""
        environment = os.environ | {
            "PYTHONPATH": str(self.checkout),
            "EIGHTPOST_CACHE": str(cache),
            "NUMBA_CACHE_DIR": str(cache / "numba"),
            "OMP_NUM_THREADS": "1",
        }
        command = [sys.executable, "-P", "-m", "eightpost", *words]
        subprocess.run(command, cwd=self.folder, env=environment, stdout=subprocess.DEVNULL, check=True)


def main() -> int:
    """Print the table; return the exit code."""
    options = _options()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        worktree = folder / "checkout"
        _git("worktree", "add", "--detach", str(worktree), options.against)
        try:
            versions = {BEFORE: _version(worktree, folder / BEFORE), NOW: _version(ROOT, folder / NOW)}
            found = measured(versions, folder, repeat=options.repeat, first=options.first)
        finally:
            _git("worktree", "remove", "--force", str(worktree))
    print(table(found))
    if options.json:
        times = {command: {BEFORE: times.before, NOW: times.now} for command, times in found.items()}
        options.json.write_text(json.dumps(times, indent=1) + "\n", encoding="utf-8")
    missed = beyond_limits(found)
    print("\n".join(missed), file=sys.stderr)
    return 1 if missed else 0


def measured(versions: dict[str, Version], folder: Path, *, repeat: int, first: int) -> dict[str, Times]:
    """Run everything, both versions alternately."""
    found = {command: Times() for command in (FIRST, LATER, HELP, *HELPS)}
    kept = {name: folder / f"cache_{name}" for name in versions}
    for k in range(first):
        for name, version in versions.items():
            shutil.rmtree(kept[name], ignore_errors=True)
            getattr(found[FIRST], name).append(version.seconds(RUN, kept[name]))
            print(f"{name}: first run {k + 1} of {first}", file=sys.stderr)
    for command, words in {LATER: RUN, HELP: ("--help",), **HELPS}.items():
        for _ in range(repeat):
            for name, version in versions.items():
                getattr(found[command], name).append(version.seconds(words, kept[name]))
        print(command, file=sys.stderr)
    return found


def table(found: dict[str, Times]) -> str:
    """Return the times as Markdown; of the help texts, only the slowest one and `eightpost --help`."""
    slowest = max(HELPS, key=lambda command: min(found[command].now))
    lines = [
        "| command | before, minimum and median [s] | now, minimum and median [s] | now / before |",
        "|---|---|---|---|",
    ]
    for command in (FIRST, LATER, HELP, slowest):
        times = found[command]
        mark = " (slowest of all commands)" if command == slowest else ""
        cells = (f"{command}{mark}", _min_and_median(times.before), _min_and_median(times.now), number(times.ratio))
        lines.append(f"| {' | '.join(cells)} |")
    times_help = min(found[slowest].now) / min(found[HELP].now)
    return "\n".join([*lines, "", f"The slowest help text takes {number(times_help)} times as long as `{HELP}`."])


def beyond_limits(found: dict[str, Times]) -> list[str]:
    """Return messages for all commands that exceed their limit."""
    least = min(found[HELP].now)
    missed = [
        f"{command}: {found[command].ratio:.2f} of its earlier time, the limit is {limit:g}"
        for command, limit in LIMITS.items()
        if found[command].ratio > limit
    ]
    return missed + [
        f"{command}: {min(found[command].now) / least:.2f} times {HELP}, the limit is {HELP_LIMIT:g}"
        for command in HELPS
        if min(found[command].now) > HELP_LIMIT * least
    ]


def _min_and_median(seconds: Sequence[float]) -> str:
    return f"{number(min(seconds))}, {number(statistics.median(seconds))}"


def _version(checkout: Path, folder: Path) -> Version:
    """Build the FMUs of the examples with a checkout's commands, which also compiles its modules to byte code."""
    shutil.copytree(checkout / "examples", folder / "examples")
    version = Version(checkout, folder)
    fit = ("fit", "examples/data/dyno_A.csv", "--law", "lpnl2", "--gas", "included", "-o", "dist/dyno_A.json")
    for words in (fit, ("build", "dist/dyno_A.json", "examples/car.toml", "-o", "dist/")):
        version.run(words, folder / "cache_build")
    version.run(("run", "--help"), folder / "cache_build")
    return version


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _git(*words: str) -> None:
    subprocess.run(["git", "-C", str(ROOT), *words], check=True, capture_output=True)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", default="25f5bbe", help="earlier commit to compare with")
    parser.add_argument("--repeat", type=int, default=7, help="number of runs of every command")
    parser.add_argument("--first", type=int, default=1, help="number of runs without cached machine code")
    parser.add_argument("--json", type=Path, help="write all times to this file")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
