"""The tests of a source: those of its area (benchmarks/mutants/areas.toml), or a few of every area.

    python -m benchmarks.mutants.area_tests [--slow] FILE      # a source, a test, or a folder
    python -m benchmarks.mutants.area_tests --quick            # what make quick runs

Runs neither nightly nor, without --slow, slow tests, and ends with the exit code of pytest; 2 if FILE has no tests.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from benchmarks.table import ROOT, parser_of

#: Packages and folders whose sources belong to areas, and the endings of sources.
PRODUCT, SOURCES = ("eightpost", "builder", "cosim", "fmus", "dissertation"), (".py", ".c", ".h")


@dataclass(frozen=True)
class Area:
    """Sources and their tests."""

    name: str  #: Name of the area.
    sources: tuple[Path, ...]  #: Paths of the sources, relative to the root of the checkout.
    tests: tuple[str, ...]  #: Arguments of pytest; the tests that are most likely to fail come first.
    quick: tuple[str, ...] = ()  #: The few tests among them that `make quick` runs.
    plugins: tuple[str, ...] = ()  #: Modules that pytest loads first (`pytest -p`) and that make a run faster.


@dataclass(frozen=True)
class Equivalent:
    """A change that does not affect any result, so that no test can detect it."""

    file: str  #: Path relative to the root of the checkout.
    line: str  #: Original line without leading and trailing spaces.
    mutant: str  #: Changed line.
    reason: str  #: Reason why no result changes.


def read_areas(root: Path = ROOT) -> list[Area]:
    """Return the areas of areas.toml.

    Raises:
        ValueError: A source belongs to no area, or a pattern matches nothing.
    """
    left = {path for folder in PRODUCT for path in _files(root / folder) if path.suffix in SOURCES}
    areas = []
    for name, area in _read(root, "areas.toml").items():
        sources = _sources(name, area["sources"], left, root)
        left -= sources
        paths = tuple(path.relative_to(root) for path in sorted(sources))
        tests, quick = (_tests(name, area[key], root) for key in ("tests", "quick"))
        areas.append(Area(name, paths, tests, quick, tuple(area.get("plugins", ()))))
    if left:
        raise ValueError(f"areas.toml: {min(left).relative_to(root)} belongs to no area: add its folder to one")
    return areas


def read_equivalents() -> list[Equivalent]:
    """Return the mutants of equivalent.toml."""
    return [Equivalent(**item) for item in _read(ROOT, "equivalent.toml").get("mutant", [])]


def _sources(name: str, patterns: Sequence[str], left: set[Path], root: Path) -> set[Path]:
    """Return the sources that match, of those that belong to no area above."""
    found: set[Path] = set()
    for pattern in patterns:
        own = left.intersection(path for match in root.glob(pattern) for path in _files(match))
        if not own - found:
            raise ValueError(f"areas.toml: {name}: {pattern!r} matches no source that is left: move it up or remove it")
        found |= own
    return found


def _tests(name: str, patterns: Sequence[str], root: Path) -> tuple[str, ...]:
    """Return the tests that match, as arguments of pytest, which expands no globs."""
    found: list[str] = []
    for pattern in patterns:
        files, colons, test = pattern.partition("::")
        matches = sorted(path.relative_to(root).as_posix() + colons + test for path in root.glob(files))
        if not matches:
            raise ValueError(f"areas.toml: {name}: no test matches {pattern!r}: write where it is now")
        found += matches
    return tuple(dict.fromkeys(found))


def _files(path: Path) -> Iterator[Path]:
    return path.rglob("*") if path.is_dir() else iter([path])


def _read(root: Path, name: str) -> dict[str, Any]:
    return tomllib.loads((root / "benchmarks" / "mutants" / name).read_text(encoding="utf-8"))


#: Number of test files from which two processes are faster than one.
_MANY = 6


def main(given: Sequence[str] | None = None) -> int:
    """Run pytest."""
    parser = parser_of(__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("file", metavar="FILE", nargs="?", type=Path, help="source, test, or folder of either")
    what.add_argument("--quick", action="store_true", help="a few tests of every area")
    parser.add_argument("--slow", action="store_true", help="slow tests, too")
    options = parser.parse_args(given)
    try:
        arguments = _together(area.quick for area in read_areas()) if options.quick else arguments_of(options.file)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    marks = "not nightly" if options.slow else "not slow and not nightly"
    command = [sys.executable, "-m", "pytest", "-q", "-m", marks, *_processes(arguments), *arguments]
    print(shlex.join(command[2:]), flush=True)
    return subprocess.run(command, cwd=ROOT, check=False).returncode


def arguments_of(file: Path) -> list[str]:
    """Return the arguments of pytest for a source, a test, or a folder of either.

    Raises:
        ValueError: It is something else.
    """
    path = file.resolve()
    if path.is_relative_to(ROOT / "tests") and path.exists():
        return [path.relative_to(ROOT).as_posix()]
    areas = [area for area in read_areas() if any((ROOT / source).is_relative_to(path) for source in area.sources)]
    if not areas:
        raise ValueError(
            f"{file}: no source ({', '.join(SOURCES)}) of {', '.join(PRODUCT)} and no test: "
            "name one, or a folder of them, for example FILE=eightpost/signals/filters.py"
        )
    print(f"{file}:", ", ".join(area.name for area in areas))
    shared = set.intersection(*(set(area.plugins) for area in areas))
    return [*loading(sorted(shared)), *_together(area.tests for area in areas)]


def loading(plugins: Iterable[str]) -> list[str]:
    """Return the arguments of pytest that load plugins."""
    return [part for name in plugins for part in ("-p", f"benchmarks.mutants.plugins.{name}")]


def _together(tests: Iterable[tuple[str, ...]]) -> list[str]:
    return list(dict.fromkeys(chain.from_iterable(tests)))


def _processes(arguments: Sequence[str]) -> list[str]:
    """Return the options for two processes, which are worth their start for many test files."""
    paths = {ROOT / argument.partition("::")[0] for argument in arguments if argument.startswith("tests")}
    files = sum(len([*path.rglob("test_*.py")]) if path.is_dir() else 1 for path in paths)
    return ["-n", "2", "--dist", "loadscope"] if files >= _MANY else []


if __name__ == "__main__":
    sys.exit(main())
