"""What the errors of several fits have in common: their changes when the same block of the same test is left out.

A fit errs where its law does not describe the shock. Shocks that were tested with the same signal and fitted with the
same law err alike, so that the difference of two of them is known better than each of them. How much they have in
common shows when each block of the test is left out (jackknife): the changes of the parameters are correlated over the
blocks as their errors are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.files import MALFORMED

#: Name of the section in the fit of a shock file, and in the uncertainty of a model.
_SECTION = "left_out_blocks"

#: Maximum number of blocks that are kept; those of longer tests are joined.
BLOCKS = 100

#: Smallest number of blocks whose changes show a correlation.
_FEWEST = 8

#: RMS difference of the blocks' velocities, as a share of their RMS value, up to which two tests have the same signal.
_SAME = 0.1

#: Significant digits and decimal places that are kept: of velocities, and of changes, which are about 0.1.
_DIGITS, _PLACES = 4, 4


@dataclass(frozen=True, slots=True)
class LeftOutBlocks:
    """Changes of fitted parameters when each of B blocks of a test is left out.

    Raises:
        InputError: The numbers of values differ, a value is not finite, or all are 0.
    """

    velocity: tuple[float, ...]  #: RMS velocity of each block (B,) [m/s], by which the same test is recognised.
    #: Change of each parameter by block (B,), about its mean and relative to the root of its sum of squares [1], by
    #: name.
    changes: Mapping[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        for name, values in (("velocity", self.velocity), *self.changes.items()):
            if len(values) != len(self.velocity) or not np.all(np.isfinite(values)) or not np.any(values):
                raise InputError(
                    f"left-out blocks: {name} must be {len(self.velocity)} finite numbers, one for each block and not "
                    "all of them 0; fit the shock again"
                )

    @classmethod
    def of(cls, velocity: Array, changes: Mapping[str, Array]) -> LeftOutBlocks:
        """Return the changes of parameters by name; a parameter that does not change, or is NaN, is omitted.

        Leaving out two blocks changes a fit by the sum of both changes, to first order, so blocks are joined by sums.

        Args:
            velocity: RMS velocity of each block (B,) [m/s].
            changes: Change of each parameter by block (B,).
        """
        ends = np.linspace(0, velocity.size, min(velocity.size, BLOCKS) + 1).astype(int)
        starts, sizes = ends[:-1], np.diff(ends)
        joint = np.sqrt(np.add.reduceat(velocity**2, starts) / sizes)
        apart = {name: _apart(np.add.reduceat(values, starts)) for name, values in changes.items()}
        kept = {name: tuple(np.round(values, _PLACES).tolist()) for name, values in apart.items() if np.any(values)}
        return cls(tuple(float(f"{value:.{_DIGITS}g}") for value in joint.tolist()), kept)

    def has_the_test_of(self, other: LeftOutBlocks) -> bool:
        """Return whether two parts had the same test: as many blocks, of the same velocities."""
        if not _FEWEST <= len(self.velocity) == len(other.velocity):
            return False
        first, second = np.array(self.velocity), np.array(other.velocity)
        return bool(np.sum((first - second) ** 2) <= _SAME**2 * np.sum(first * second))

    def section(self) -> dict[str, Any]:
        """Return the changes as the section of a JSON document; `left_out_of` reads it."""
        changes = {name: list(values) for name, values in self.changes.items()}
        return {_SECTION: {"velocity [m/s]": list(self.velocity), "changes": changes}}

    @classmethod
    def from_json(cls, document: Any) -> LeftOutBlocks:
        """Return the changes of a section.

        Raises:
            InputError: The document is not one of left-out blocks.
        """
        try:
            velocity, changes = document["velocity [m/s]"], document["changes"]
            return cls(_numbers(velocity), {str(name): _numbers(values) for name, values in changes.items()})
        except InputError:
            raise
        except MALFORMED as error:
            raise InputError(f"left-out blocks: {error}") from error


class FittedParameter(NamedTuple):
    """A parameter of a fitted part, and the changes of the part's fit; None if the part states none."""

    blocks: LeftOutBlocks | None
    name: str


def _apart(values: Array) -> Array:
    """Return values about their mean, relative to the root of the sum of squares; 0 if they are equal or NaN."""
    apart = values - values.mean()
    size = float(np.linalg.norm(apart))
    return apart / size if size > 0.0 else np.zeros(values.size)


def left_out_of(document: Mapping[str, Any]) -> LeftOutBlocks | None:
    """Return the changes in the section of a shock file's fit or of a model's uncertainty; None if it has none.

    Raises:
        InputError: The section is not one of left-out blocks.
    """
    section = document.get(_SECTION)
    return None if section is None else LeftOutBlocks.from_json(section)


def _numbers(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def correlation_of(parameters: Sequence[FittedParameter]) -> Array:
    """Return the correlation (n, n) of the errors of fitted parameters.

    The same parameter of shocks with the same test has the correlation of its changes, which is shrunk the more, the
    less it exceeds what independent changes of so few blocks would show (Schaefer and Strimmer 2005). All others count
    as independent. That includes different parameters of one fit: the changes say that their errors largely cancel,
    those of both sides for example, but an error of the law's form does not follow such a combination.
    """
    found = np.eye(len(parameters))
    for places in _groups(parameters):
        changes = [one.blocks.changes[one.name] for one in (parameters[k] for k in places) if one.blocks]
        found[np.ix_(places, places)] = _shrunk(np.array(changes))
    return found


def square_root(covariance: Array) -> Array:
    """Return the symmetric square root (n, n) of a covariance; negative eigenvalues, due to rounding, count as 0."""
    variances, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.sqrt(np.maximum(variances, 0.0))) @ axes.T)


def _groups(parameters: Sequence[FittedParameter]) -> list[list[int]]:
    """Return the positions of equal parameters of parts with the same test: that of the first part of each group."""
    groups: list[tuple[LeftOutBlocks, list[int]]] = []
    for place, (blocks, name) in enumerate(parameters):
        if blocks is None or name not in blocks.changes:
            continue
        for first, places in groups:
            if parameters[places[0]].name == name and blocks.has_the_test_of(first):
                places.append(place)
                break
        else:
            groups.append((blocks, [place]))
    return [places for _, places in groups]


def _shrunk(changes: Array) -> Array:
    """Return the correlation (n, n) of changes (n, B), shrunk towards independence; equal ones are one fit."""
    changes, place = np.unique(changes, axis=0, return_inverse=True)
    size = np.linalg.norm(changes, axis=1, keepdims=True)
    found = (changes / size) @ (changes / size).T
    apart = found[~np.eye(len(found), dtype=bool)]
    by_chance = float(np.sum((1.0 - np.minimum(apart**2, 1.0)) ** 2)) / max(changes.shape[1] - 1, 1)
    share = min(by_chance / max(float(np.sum(apart**2)), 1e-300), 1.0)
    found *= 1.0 - share
    np.fill_diagonal(found, 1.0)
    return np.asarray(found[np.ix_(place.ravel(), place.ravel())])
