"""Factors: the positions of a setup space at which a build can be chosen independently."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.study.setup import SetupSpace

Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Factor:
    """A position at which builds are exchanged: a corner, or corners that always have the same build.

    Attributes:
        name: Name of the corner, or of the corners as `lf+rf`.
        builds: Allowed builds; their order has no meaning.
    """

    name: str
    builds: tuple[str, ...]


def factors_of(space: SetupSpace) -> tuple[Factor, ...]:
    """Return the F factors of a space, including those with a single build."""
    found = []
    for group in _groups(space):
        first, *others = (space.corners[corner] for corner in group)
        common = tuple(build for build in first if all(build in other for other in others))
        found.append(Factor("+".join(group), common))
    return tuple(found)


def levels_of(space: SetupSpace, indices: Integers) -> Integers:
    """Return the builds of setups as indices into the factors' builds.

    Args:
        space: Space of the setups.
        indices: Numbers of setups (N,); each must satisfy `alike` of the space.

    Returns:
        Index of the build of each factor (N, F).
    """
    digits, corners = space.digits(indices), list(space.corners)
    columns = []
    for group, factor in zip(_groups(space), factors_of(space), strict=True):
        place = {build: level for level, build in enumerate(factor.builds)}
        known = np.array([place.get(build, -1) for build in space.corners[group[0]]])
        columns.append(known[digits[:, corners.index(group[0])]])
    return np.stack(columns, axis=-1)


def indices_of(space: SetupSpace, levels: Integers) -> Integers:
    """Return the numbers (N,) of the setups with these levels (N, F); the inverse of `levels_of`."""
    digits = np.empty((levels.shape[0], len(space.corners)), dtype=np.int64)
    corners = list(space.corners)
    for group, factor, level in zip(_groups(space), factors_of(space), levels.T, strict=True):
        for corner in group:
            own = np.array([space.corners[corner].index(build) for build in factor.builds])
            digits[:, corners.index(corner)] = own[level]
    return np.asarray(np.ravel_multi_index(tuple(digits.T), space.radices), dtype=np.int64)


def _groups(space: SetupSpace) -> list[tuple[str, ...]]:
    """Return the corners in groups with the same build, in the corners' order; overlapping groups are merged."""
    group = {corner: {corner} for corner in space.corners}
    for alike in space.alike:
        joined = set().union(*(group[corner] for corner in alike))
        group |= dict.fromkeys(joined, joined)
    sorted_groups = (tuple(c for c in space.corners if c in group[corner]) for corner in space.corners)
    return list(dict.fromkeys(sorted_groups))


def varied(factors: Sequence[Factor]) -> list[int]:
    """Return the indices of the factors with two or more builds."""
    return [place for place, factor in enumerate(factors) if len(factor.builds) > 1]
