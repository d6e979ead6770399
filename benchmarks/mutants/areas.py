"""Which sources are changed, and which tests must notice: areas.toml; which changes change nothing: equivalent.toml."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Area:
    """Sources and their tests.

    Args:
        name: Name of the area.
        sources: Glob patterns of the sources that are changed, from the root of the checkout.
        tests: Arguments of pytest, the tests that are likeliest to fail first.
        plugins: Modules that pytest loads first (`pytest -p`), and that make a run cheaper.
        share: Weight of the area in the number of mutants.
    """

    name: str
    sources: tuple[str, ...]
    tests: tuple[str, ...]
    plugins: tuple[str, ...] = ()
    share: float = 1.0

    def files(self, root: Path = ROOT) -> list[Path]:
        """Return the sources in the order of their names.

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
    """A change after which every result is the same, so that no test can notice it.

    Args:
        file: Path from the root of the checkout.
        line: The line as it is, without the spaces around it.
        mutant: The line as the change makes it.
        reason: Why nothing changes.
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
