"""Setups: one build of the bank at every corner, numbered."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from math import prod

import numpy as np

from eightpost.array_types import Integers
from eightpost.errors import InputError


@dataclass(frozen=True, slots=True)
class Setup:
    """A build at every corner."""

    index: int  #: Number of the setup in its space.
    builds: Mapping[str, str]  #: Name of the build by corner.

    def __str__(self) -> str:
        """Return the builds corner by corner: `lf C/B, rf C/B, lr AA/B, rr C/C`."""
        return ", ".join(f"{corner} {build}" for corner, build in self.builds.items())


@dataclass(frozen=True)
class SetupSpace:
    """All setups that a study may choose from (Theta of Eq 2.3).

    A setup's number is a mixed-radix number: its digits are the positions of the corners' builds among the builds
    allowed there. The last corner is the last digit.

    Raises:
        InputError: A corner has no build or the same build twice, a group names an unknown corner, or the corners of a
            group have no build in common.
    """

    corners: Mapping[str, tuple[str, ...]]  #: Allowed builds by corner.
    alike: tuple[tuple[str, ...], ...] = ()  #: Groups of corners that always have the same build: `(("lf", "rf"),)`.

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", {name: tuple(builds) for name, builds in self.corners.items()})
        object.__setattr__(self, "alike", tuple(tuple(group) for group in self.alike))
        for corner, builds in self.corners.items():
            if not builds or len(set(builds)) < len(builds):
                raise InputError(f"corners: {corner} needs one or more different builds, not {list(builds)}")
        for group in self.alike:
            self._check_group(group)

    @property
    def radices(self) -> tuple[int, ...]:
        """Number of allowed builds at each corner."""
        return tuple(len(builds) for builds in self.corners.values())

    @property
    def full(self) -> int:
        """Number of setups without the restriction `alike`; every setup number is below it."""
        return prod(self.radices)

    def __len__(self) -> int:
        return int(self.indices.size)

    def __iter__(self) -> Iterator[Setup]:
        return (self.setup(int(index)) for index in self.indices)

    @cached_property
    def indices(self) -> Integers:
        """Numbers of all setups in increasing order (S,).

        Raises:
            InputError: There are more setups than the memory holds.
        """
        try:
            return self._numbers() if self.alike else np.arange(self.full, dtype=np.int64)
        except MemoryError as error:
            raise InputError(
                f"the builds of the corners give {self.full:.2g} setups, more than the memory holds; name fewer builds "
                "in [corners], or corners that have the same build in alike"
            ) from error

    def _numbers(self) -> Integers:
        """Return the numbers, found corner by corner: one that is like an earlier one has the build of that one."""
        numbers, chosen = np.zeros(1, dtype=np.int64), dict[str, Integers]()
        for corner, builds in self.corners.items():
            if mates := {mate for group in self.alike if corner in group for mate in group if mate in chosen}:
                first, *others = (_places_of(self.corners[mate], builds)[chosen[mate]] for mate in mates)
                rows = np.flatnonzero(np.all([first >= 0, *(first == other for other in others)], axis=0))
                places = first[rows]
            else:
                rows = np.repeat(np.arange(numbers.size), len(builds))
                places = np.tile(np.arange(len(builds)), numbers.size)
            chosen = {name: earlier[rows] for name, earlier in chosen.items()} | {corner: places}
            numbers = numbers[rows] * len(builds) + places
        return numbers

    def digits(self, indices: Integers) -> Integers:
        """Return the positions of the corners' builds (S, corners) for setups by number (S,)."""
        return np.stack(np.unravel_index(indices, self.radices), axis=-1).astype(np.int64)

    def setup(self, index: int) -> Setup:
        """Return a setup by its number.

        Raises:
            InputError: No setup has this number.
        """
        if not 0 <= index < self.full:
            raise InputError(f"there is no setup {index}; they are numbered 0 to {self.full - 1}")
        places = np.unravel_index(index, self.radices)
        pairs = zip(self.corners.items(), places, strict=True)
        return Setup(int(index), {corner: builds[int(place)] for (corner, builds), place in pairs})

    def find(self, builds: Mapping[str, str]) -> Setup:
        """Return the setup with the given builds by corner.

        Raises:
            InputError: A corner is missing or unknown, or its build is not allowed there.
        """
        if set(builds) != set(self.corners):
            raise InputError(
                f"a setup must give builds at {', '.join(self.corners)}, not at {', '.join(builds) or 'no corner'}"
            )
        return self.setup(int(np.ravel_multi_index([self._place(c, builds[c]) for c in self.corners], self.radices)))

    def _place(self, corner: str, build: str) -> int:
        allowed = self.corners[corner]
        if build not in allowed:
            close = get_close_matches(build, allowed, n=1)
            advice = f"; did you mean {close[0]}?" if close else ""
            raise InputError(f"{corner} cannot have the build {build!r}, only one of {', '.join(allowed)}{advice}")
        return allowed.index(build)

    def _check_group(self, group: tuple[str, ...]) -> None:
        if len(group) < 2 or (unknown := sorted(set(group) - set(self.corners))):
            what = f"there is no corner {unknown[0]!r}" if len(group) > 1 else "a group needs two or more corners"
            raise InputError(f"alike: {list(group)}: {what}; the corners are {', '.join(self.corners)}")
        if not set.intersection(*(set(self.corners[corner]) for corner in group)):
            raise InputError(
                f"alike: the corners {', '.join(group)} have no build in common; change [corners] or alike"
            )


def _places_of(builds: tuple[str, ...], allowed: tuple[str, ...]) -> Integers:
    """Return the place of each build (B,) among those allowed at a corner, -1 if it is not allowed there."""
    places = {build: place for place, build in enumerate(allowed)}
    return np.array([places.get(build, -1) for build in builds], dtype=np.int64)
