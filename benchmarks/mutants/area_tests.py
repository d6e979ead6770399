"""The tests of a source: those of its area (benchmarks/mutants/areas.toml), or a few of every area.

    python -m benchmarks.mutants.area_tests [--slow] FILE      # a source, a test, or a folder
    python -m benchmarks.mutants.area_tests --quick            # what make quick runs

Runs neither nightly nor, without --slow, slow tests, and ends with the exit code of pytest; 2 if FILE has no tests.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

from benchmarks.mutants.areas import PRODUCT, ROOT, SOURCES, read_areas

#: Number of test files from which two processes are faster than one.
_MANY = 6


def main(given: Sequence[str] | None = None) -> int:
    """Run pytest."""
    options = _options(given)
    try:
        arguments = quick_arguments() if options.quick else arguments_of(options.file)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    marks = "not nightly" if options.slow else "not slow and not nightly"
    command = [sys.executable, "-m", "pytest", "-q", "-m", marks, *_processes(arguments), *arguments]
    print(shlex.join(command[2:]), flush=True)
    return subprocess.run(command, cwd=ROOT, check=False).returncode


def quick_arguments() -> list[str]:
    """Return the arguments of pytest for a few tests of every area."""
    return _together(area.quick for area in read_areas())


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
    return [*_plugins(shared), *_together(area.tests for area in areas)]


def _options(given: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("file", metavar="FILE", nargs="?", type=Path, help="source, test, or folder of either")
    what.add_argument("--quick", action="store_true", help="a few tests of every area")
    parser.add_argument("--slow", action="store_true", help="slow tests, too")
    return parser.parse_args(given)


def _together(tests: Iterable[tuple[str, ...]]) -> list[str]:
    return list(dict.fromkeys(chain.from_iterable(tests)))


def _plugins(names: set[str]) -> list[str]:
    return [part for name in sorted(names) for part in ("-p", f"benchmarks.mutants.plugins.{name}")]


def _processes(arguments: Sequence[str]) -> list[str]:
    """Return the options for two processes, which are worth their start for many test files."""
    paths = {ROOT / argument.partition("::")[0] for argument in arguments if argument.startswith("tests")}
    files = sum(len([*path.rglob("test_*.py")]) if path.is_dir() else 1 for path in paths)
    return ["-n", "2", "--dist", "loadscope"] if files >= _MANY else []


if __name__ == "__main__":
    sys.exit(main())
