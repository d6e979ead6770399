"""The areas of areas.toml (sources and their tests), and the equivalent mutants of equivalent.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]

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
