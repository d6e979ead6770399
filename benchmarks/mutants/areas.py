"""The areas of areas.toml (sources and their tests), and the equivalent mutants of equivalent.toml."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Area:
    """Sources and their tests.

    Attributes:
        name: Name of the area.
        sources: Glob patterns of the sources to change, relative to the root of the checkout.
        tests: Arguments of pytest; the tests that are most likely to fail come first.
        plugins: Modules that pytest loads first (`pytest -p`) and that make a run faster.
        share: Weight of the area in the number of mutants.
    """

    name: str
    sources: tuple[str, ...]
    tests: tuple[str, ...]
    plugins: tuple[str, ...] = ()
    share: float = 1.0

    def files(self, root: Path = ROOT) -> list[Path]:
        """Return the sources in alphabetical order.

        Raises:
            FileNotFoundError: A pattern matches nothing.
        """
        found: set[Path] = set()
        for pattern in self.sources:
            matches = set(root.glob(pattern))
            if not matches:
                raise FileNotFoundError(f"areas.toml: {self.name}: no source matches {pattern!r}")
            found |= matches
        return sorted(found)


@dataclass(frozen=True)
class Equivalent:
    """A change that does not affect any result, so that no test can detect it.

    Attributes:
        file: Path relative to the root of the checkout.
        line: Original line without leading and trailing spaces.
        mutant: Changed line.
        reason: Reason why no result changes.
    """

    file: str
    line: str
    mutant: str
    reason: str


def read_areas() -> list[Area]:
    """Return the areas of areas.toml."""
    return [
        Area(name, tuple(area.pop("sources")), tuple(area.pop("tests")), tuple(area.pop("plugins", ())), **area)
        for name, area in _read("areas.toml").items()
    ]


def read_equivalents() -> list[Equivalent]:
    """Return the mutants of equivalent.toml."""
    return [Equivalent(**item) for item in _read("equivalent.toml").get("mutant", [])]


def _read(name: str) -> dict[str, dict[str, object]]:
    return tomllib.loads(Path(__file__).with_name(name).read_text(encoding="utf-8"))
