"""A mutant: a source with one change."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import unified_diff
from pathlib import Path

from benchmarks.mutants.areas import ROOT, Area
from benchmarks.mutants.c_sites import c_sites
from benchmarks.mutants.python_sites import python_sites
from benchmarks.mutants.site import Site


@dataclass(frozen=True)
class Mutant:
    """A source with one change."""

    area: str  #: Name of the area.
    file: str  #: Path relative to the root of the checkout.
    line: int  #: Line number of the change, from 1.
    before: str  #: Original source.
    after: str  #: Changed source.

    @property
    def key(self) -> str:
        """Key that is equal for equal changes of equal sources."""
        return hashlib.sha256(f"{self.area}\0{self.file}\0{self.after}".encode()).hexdigest()[:16]

    @property
    def lines(self) -> tuple[str, str]:
        """Original and changed line, without leading and trailing spaces."""
        return tuple(text.splitlines()[self.line - 1].strip() for text in (self.before, self.after))

    @property
    def diff(self) -> str:
        """Change as a patch."""
        texts = (text.splitlines() for text in (self.before, self.after))
        return "\n".join(unified_diff(*texts, f"a/{self.file}", f"b/{self.file}", n=1, lineterm=""))


def mutants(areas: Sequence[Area], seed: int, root: Path = ROOT) -> Iterator[Mutant]:
    """Yield mutants of areas in random order, one for each place of their sources.

    A longer sample with the same seed starts with the shorter one.
    """
    places = [(area, path, site) for area in areas for path in area.sources for site in _sites(root / path)]
    chance = random.Random(seed)
    chance.shuffle(places)
    for area, path, site in places:
        before = (root / path).read_text(encoding="utf-8")
        after = chance.choice(site.changes)(before)
        if after is not None and after != before:
            yield Mutant(area.name, path.as_posix(), site.line, before, after)


def _sites(path: Path) -> list[Site]:
    find = python_sites if path.suffix == ".py" else c_sites
    return find(path.read_text(encoding="utf-8"))
