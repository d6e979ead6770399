"""Benchmark of what users wait for: processor time of commands, and size of an installation, beside another version.

    python -m benchmarks.startup [--against COMMIT] [--repeat 3] [--install]

Both versions run alternately with the same Python and packages, each on FMUs that it built from the examples. A *first*
run finds no kept machine code; the other commands find that of earlier ones. Processor time includes all child
processes; it is up to twice as long on a busy machine, so the ratio is what counts. `--install` also installs both
versions from the package index into new environments, which takes minutes. Prints Markdown with the targets; the exit
code is 1 if one is missed. Requires git, and Linux or macOS.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.table import ROOT, checked_out, number

BEFORE, NOW = "before", "now"
RUN = ("run", "examples/seven_dof.toml", "-o", "out")
STUDY = ("study", "examples/study.toml", "-o", "studied")
FIRST = "first run [s]"

#: Commands that are repeated, by their row in the table.
COMMANDS: Mapping[str, tuple[str, ...]] = {
    "later run [s]": RUN,
    "fit of one record [s]": ("fit", "examples/data/dyno_A.csv", "-o", "fitted.json"),
    "study of 2401 setups [s]": STUDY,
    "--help [s]": ("--help",),
}
#: Extras that are installed, by the row in the table.
INSTALLED = {"minimal installation [MB]": "", "installation of all [MB]": "[all]"}

#: Largest acceptable figure of each row.
TARGETS: Mapping[str, float] = dict(
    zip((FIRST, *COMMANDS, *INSTALLED), (6.0, 1.5, 2.0, 5.0, 0.3, 350.0, 900.0), strict=True)
)


@dataclass(frozen=True)
class Figures:
    """Figures of one row, per version: processor times [s] or sizes [MB], of which the smallest counts."""

    before: list[float] = field(default_factory=list)  #: Those of the earlier version.
    now: list[float] = field(default_factory=list)  #: Those of this version.


@dataclass(frozen=True)
class Version:
    """A checkout, and a folder with the examples and what its commands wrote."""

    checkout: Path
    folder: Path

    def seconds(self, words: Sequence[str]) -> float:
        """Run a command and return its processor time [s]."""
        before = _children()
        self.run(words)
        return _children() - before

    def run(self, words: Sequence[str]) -> None:
        """Run a command. The exit code 1 is a verdict."""
        cache = self.folder / "cache"
        environment = os.environ | {
            "PYTHONPATH": str(self.checkout),
            "EIGHTPOST_CACHE": str(cache),
            "NUMBA_CACHE_DIR": str(cache / "numba"),
            "OMP_NUM_THREADS": "1",
        }
        command = [sys.executable, "-P", "-m", "eightpost", *words]
        ran = subprocess.run(command, cwd=self.folder, env=environment, stdout=subprocess.DEVNULL, check=False)
        if ran.returncode not in (0, 1):
            raise SystemExit(f"{' '.join(words)} of {self.checkout} ended with {ran.returncode}")

    def megabytes(self, extras: str) -> float:
        """Install the checkout with extras into a new environment; return its size without pip and byte code [MB]."""
        place = self.folder / "environment"
        subprocess.run([sys.executable, "-m", "venv", "--clear", "--without-pip", place], check=True)
        pip = [sys.executable, "-m", "pip", "--python", place / "bin" / "python", "install", "--quiet", "--no-compile"]
        subprocess.run([*pip, f"{self.checkout}{extras}"], check=True)
        return sum(path.stat().st_size for path in place.rglob("*") if not path.is_symlink() and path.is_file()) / 1e6


def main() -> int:
    """Print the table; return the exit code."""
    options = _options()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with checked_out(options.against) as before:
            versions = {BEFORE: _version(before, folder / BEFORE), NOW: _version(ROOT, folder / NOW)}
            found = measured(versions, options.repeat, INSTALLED if options.install else {})
    print(table(found))
    return 1 if missed(found) else 0


def measured(versions: Mapping[str, Version], repeat: int, installed: Mapping[str, str]) -> dict[str, Figures]:
    """Run everything, both versions alternately."""
    found = {row: Figures() for row in (FIRST, *COMMANDS, *installed)}
    for row, words in COMMANDS.items():
        for _ in range(repeat):
            for name, version in versions.items():
                shutil.rmtree(version.folder / "studied", ignore_errors=True)
                getattr(found[row], name).append(version.seconds(words))
        print(row, file=sys.stderr)
    for name, version in versions.items():
        shutil.rmtree(version.folder / "cache")
        getattr(found[FIRST], name).append(version.seconds(RUN))
    for row, extras in installed.items():
        for name, version in versions.items():
            getattr(found[row], name).append(version.megabytes(extras))
    return found


def table(found: Mapping[str, Figures]) -> str:
    """Return the smallest figures of both versions as Markdown, with ratio and target."""
    lines = ["| | before | now | now / before | target |", "|---|---|---|---|---|"]
    for row, figures in found.items():
        before, now = min(figures.before), min(figures.now)
        lines.append(f"| {' | '.join((row, *map(number, (before, now, now / before, TARGETS[row]))))} |")
    return "\n".join(lines)


def missed(found: Mapping[str, Figures]) -> list[str]:
    """Return the rows whose target this version misses."""
    return [row for row, figures in found.items() if min(figures.now) > TARGETS[row]]


def _version(checkout: Path, folder: Path) -> Version:
    """Build the FMUs of the examples with a checkout's commands, which also compiles its modules to byte code."""
    shutil.copytree(checkout / "examples", folder / "examples")
    version = Version(checkout, folder)
    fit = ("fit", "examples/data/dyno_A.csv", "--law", "lpnl2", "--gas", "included", "-o", "dist/dyno_A.json")
    build = ("build", "dist/dyno_A.json", "examples/car.toml", "-o", "dist/")
    for words in (fit, build, *COMMANDS.values()):
        version.run(words)
    return version


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", default="HEAD", help="commit to compare this checkout with")
    parser.add_argument("--repeat", type=int, default=3, help="number of runs of every command")
    parser.add_argument("--install", action="store_true", help="also install both versions, and compare sizes")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
