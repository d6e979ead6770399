"""Division of the measured curves into the effects of the adjusters: main effects, then what combinations add."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.shock import Axis, Term

#: Singular values of the effects below this share of the largest cannot be determined.
_NO_INFORMATION = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """Values at the reference setting and their changes."""

    reference: Array  #: Values (P,) at the reference setting.
    terms: tuple[Term, ...]  #: Changes with the settings.
    #: Remainder (G, P) that the terms do not describe, for each measured setting; 0 except in scattered tests.
    left: Array


def effects_of(axes: Sequence[Axis], settings: Sequence[tuple[float, ...]], values: Array) -> Effects:
    """Return the effects of axes on values.

    If every setting of each axis was measured with the others at their reference, these measurements are the main
    effects, and other combinations add terms of their own. Otherwise the main effects are fitted to all settings by
    least squares, and combinations add nothing.

    Args:
        axes: Axes of the settings.
        settings: Measured settings (G), all different.
        values: Values at each (G, P).

    Raises:
        InputError: The settings do not separate the effects of the axes.
    """
    design = _design(axes, settings)
    reference = tuple(axis.reference for axis in axes)
    off = np.array([sum(v != r for v, r in zip(setting, reference, strict=True)) for setting in settings])
    one_at_a_time = off <= 1
    is_complete = int(one_at_a_time.sum()) == design.shape[1]
    used = one_at_a_time if is_complete else np.ones(len(settings), dtype=bool)
    _check_rank(axes, design[used])
    found, *_ = np.linalg.lstsq(design[used], values[used], rcond=None)
    terms, start = [], 1
    for axis in axes:
        rows = np.zeros((len(axis.nodes), values.shape[1]))
        others = [k for k, node in enumerate(axis.nodes) if node != axis.reference]
        rows[others] = found[start : start + len(others)]
        start += len(others)
        terms.append(_term((axis.name,), rows))
    left = values - design @ found
    if is_complete:
        left = np.where(one_at_a_time[:, None], 0.0, left)
        for size in range(2, len(axes) + 1):
            for places in itertools.combinations(range(len(axes)), size):
                terms += _combined(axes, places, settings, left)
    return Effects(found[0], tuple(terms), left)


def _design(axes: Sequence[Axis], settings: Sequence[tuple[float, ...]]) -> Array:
    """Return the matrix (G, 1 + nodes) of the main effects; the effect of a reference is 0."""
    columns = [np.ones(len(settings))]
    for number, axis in enumerate(axes):
        here = np.array([setting[number] for setting in settings])
        columns += [(here == node).astype(float) for node in axis.nodes if node != axis.reference]
    return np.array(columns).T


def _check_rank(axes: Sequence[Axis], design: Array) -> None:
    _, strength, directions = np.linalg.svd(design, full_matrices=True)
    rank = int(np.sum(strength > _NO_INFORMATION * strength[0]))
    if rank == design.shape[1]:
        return
    loose = np.abs(directions[rank:]).max(axis=0) > 1e-6
    owners = ["the reference", *(a.name for a in axes for node in a.nodes if node != a.reference)]
    names = list(dict.fromkeys(name for name, free in zip(owners, loose, strict=True) if free))
    raise InputError(
        f"these files do not separate the effects of {', '.join(names)}: they change together; measure each adjuster "
        "also with the others at their reference"
    )


def _combined(
    axes: Sequence[Axis], places: tuple[int, ...], settings: Sequence[tuple[float, ...]], left: Array
) -> list[Term]:
    """Return the term of a combination of axes, and subtract it from what is left; none if it was not measured."""
    nodes = [axes[place].nodes for place in places]
    combinations = list(itertools.product(*nodes))
    rows = np.zeros((len(combinations), left.shape[1]))
    owned = [
        k
        for k, setting in enumerate(settings)
        if all(
            (value != axis.reference) == (i in places)
            for i, (value, axis) in enumerate(zip(setting, axes, strict=True))
        )
    ]
    if not owned:
        return []
    for k in owned:
        rows[combinations.index(tuple(settings[k][place] for place in places))] = left[k]
        left[k] = 0.0
    term = _term(tuple(axes[place].name for place in places), rows)
    _subtract(axes, places, combinations, rows, settings, left)
    return [term]


def _changed(axes: Sequence[Axis], setting: Sequence[float]) -> set[int]:
    """Return the numbers of the axes that are not at their reference."""
    return {i for i, (value, axis) in enumerate(zip(setting, axes, strict=True)) if value != axis.reference}


def _subtract(
    axes: Sequence[Axis],
    places: tuple[int, ...],
    combinations: Sequence[tuple[float, ...]],
    rows: Array,
    settings: Sequence[tuple[float, ...]],
    left: Array,
) -> None:
    """Subtract a term from what is left at settings in which further axes differ from their reference."""
    for k, setting in enumerate(settings):
        if set(places) < _changed(axes, setting):
            left[k] -= rows[combinations.index(tuple(setting[place] for place in places))]


def _term(names: tuple[str, ...], rows: Array) -> Term:
    return Term(names, tuple(tuple(row) for row in rows.tolist()))
