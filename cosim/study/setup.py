"""Setups: one build of the bank at every corner, numbered."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from math import prod

import numpy as np
from numpy.typing import NDArray

from eightpost.errors import InputError

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Setup:
    """A build at every corner.

    Args:
        index: Its number in the space that it comes from.
        builds: Name of the build by corner.
    """

    index: int
    builds: Mapping[str, str]

    def __str__(self) -> str:
        """Corner by corner: `lf C/B, rf C/B, lr AA/B, rr C/C`."""
        return ", ".join(f"{corner} {build}" for corner, build in self.builds.items())


@dataclass(frozen=True)
class SetupSpace:
    """All setups that a study may choose from, Theta of Eq 2.3.

    A setup's number is a mixed radix number: its digits are the places of the corners' builds among those that each
    corner may have; the last corner counts fastest.

    Args:
        corners: Builds that each corner may have.
        alike: Corners that have the same build, in groups: `(("lf", "rf"),)`.

    Raises:
        InputError: A corner has no build or has one twice, or a group names a corner that is not there, or its corners
            have no build in common.
    """

    corners: Mapping[str, tuple[str, ...]]
    alike: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", {name: tuple(builds) for name, builds in self.corners.items()})
        object.__setattr__(self, "alike", tuple(tuple(group) for group in self.alike))
        for corner, builds in self.corners.items():
            if not builds or len(set(builds)) < len(builds):
                raise InputError(f"corners: {corner} needs a build or more, each once, not {list(builds)}")
        for group in self.alike:
            self._check_group(group)

    @property
    def radices(self) -> tuple[int, ...]:
        """How many builds each corner may have."""
        return tuple(len(builds) for builds in self.corners.values())

    @property
    def full(self) -> int:
        """How many setups there would be if no corners were alike; every number is below it."""
        return prod(self.radices)

    def __len__(self) -> int:
        return int(self.indices.size)

    def __iter__(self) -> Iterator[Setup]:
        return (self.setup(int(index)) for index in self.indices)

    @cached_property
    def indices(self) -> Indices:
        """The numbers of all setups (S,), in order."""
        every = np.arange(self.full, dtype=np.int64)
        if not self.alike:
            return every
        digits, keep = self.digits(every), np.ones(every.size, dtype=bool)
        names = list(self.corners)
        for group in self.alike:
            first, *others = (np.array(self.corners[c])[digits[:, names.index(c)]] for c in group)
            for other in others:
                keep &= first == other
        return every[keep]

    def digits(self, indices: Indices) -> Indices:
        """Return the place of each corner's build (S, corners) for setups by number (S,)."""
        return np.stack(np.unravel_index(indices, self.radices), axis=-1).astype(np.int64)

    def setup(self, index: int) -> Setup:
        """Return a setup by its number.

        Raises:
            InputError: There is no such number.
        """
        if not 0 <= index < self.full:
            raise InputError(f"there is no setup {index}; they are numbered 0 to {self.full - 1}")
        places = np.unravel_index(index, self.radices)
        pairs = zip(self.corners.items(), places, strict=True)
        return Setup(int(index), {corner: builds[int(place)] for (corner, builds), place in pairs})

    def find(self, builds: Mapping[str, str]) -> Setup:
        """Return the setup with these builds by corner.

        Raises:
            InputError: A corner is missing or unknown, or may not have its build.
        """
        if set(builds) != set(self.corners):
            raise InputError(f"a setup names the corners {', '.join(self.corners)}, not {', '.join(builds) or 'none'}")
        return self.setup(int(np.ravel_multi_index([self._place(c, builds[c]) for c in self.corners], self.radices)))

    def _place(self, corner: str, build: str) -> int:
        allowed = self.corners[corner]
        if build not in allowed:
            close = get_close_matches(build, allowed, n=1)
            advice = f"; did you mean {close[0]}?" if close else ""
            raise InputError(f"{corner} cannot have the build {build!r}, only {', '.join(allowed)}{advice}")
        return allowed.index(build)

    def _check_group(self, group: tuple[str, ...]) -> None:
        if len(group) < 2 or (unknown := sorted(set(group) - set(self.corners))):
            what = f"there is no corner {unknown[0]!r}" if len(group) > 1 else "it names fewer than two corners"
            raise InputError(f"alike: {list(group)}: {what}; there are {', '.join(self.corners)}")
        if not set.intersection(*(set(self.corners[corner]) for corner in group)):
            raise InputError(f"alike: the corners {', '.join(group)} have no build in common")
