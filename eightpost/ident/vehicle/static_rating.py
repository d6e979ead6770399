"""The static rating of a car on an 8-post rig: its spring matrix, and what it carries without load (6.4.4).

    F_aero = K X_aero + F_zero          (6.10)
    K_m = T_f K T_x^-1                  (6.11)

F and X are forces and positions of the aeroloaders, averaged over every level that is held, both positive down; K_m
relates the modes' forces to their displacements. What tires carry and where the chassis stands at zero load follows
alike, by least squares over the loads: the static state of a vehicle file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import InputError
from eightpost.ident.vehicle.holds import holds
from eightpost.rig.post.modes import MODES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]

_CORNERS = ("lf", "rf", "lr", "rr")

#: What has a static value, as the last part of a channel's name.
_STATIC = ("tire_force", "ride_height")

#: A tire that carries less than this part of the most it carries at any level has left the ground [1].
_LIFTED = 0.01

#: Loads whose smallest way of moving is below this part of the largest are not moved in all ways [1].
_MOVED = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class StaticRating:
    """What static records tell.

    Attributes:
        levels: How many levels were held with all tires on the ground.
        lifted: How many were left out: from the first one of a record at which a tire carries nothing.
        loads: The loads that were held.
        zero: Tire forces and ride heights at zero load by channel, SI.
        stiffness: K (4, 4) [N/m] by aeroloader; None where the loads were not moved in all four ways.
        zero_force: F_zero (4,) [N]; None alike.
        modal: K_m (4, 4) in heave, pitch, roll, warp [N/m, N/rad, N.m/m, N.m/rad]; None alike.
        unexplained: RMS of each aeroloader's force that K leaves, over its RMS (4,) [1]; None alike.
    """

    levels: int
    lifted: int
    loads: tuple[str, ...]
    zero: Mapping[str, float]
    stiffness: Array | None = None
    zero_force: Array | None = None
    modal: Array | None = None
    unexplained: Array | None = None


def rate_statically(records: Sequence[TimeSeries], loads: Sequence[str]) -> StaticRating:
    """Rate a car by its static records.

    Args:
        records: As measured, with their means, any rate: loads that step from level to level, roads at rest.
        loads: The loads among their channels.

    Raises:
        InputError: No record holds a level, or none has a load.
    """
    there = tuple(name for name in loads if all(name in record for record in records))
    if not there:
        raise InputError(f"the static records have none of the loads {', '.join(loads)}; they move what is rated")
    names = [n for n in records[0].names if all(n in r for r in records)]
    held = [_levels(record, names, there) for record in records]
    table = np.concatenate([levels[: _until_lifted(levels, names)] for levels in held])
    if len(table) < 2:
        raise InputError(
            f"the static records hold {len(table)} levels of {', '.join(there)} with all tires on the ground; give "
            "records that hold each for some seconds (6.1.3)"
        )
    columns = dict(zip(names, table.T, strict=True))
    force = np.stack([columns[name] for name in there])
    static = [name for name in names if name.rpartition(".")[2] in _STATIC]
    zero = {name: _affine(force, columns[name], least=_MOVED)[-1] for name in static}
    lifted = sum(map(len, held)) - len(table)
    found = StaticRating(len(table), lifted, there, {name: float(value) for name, value in zero.items()})
    return _with_springs(found, columns)


def _with_springs(found: StaticRating, columns: Mapping[str, Array]) -> StaticRating:
    """Add the spring matrix, where four aeroloaders and their positions were moved in all ways."""
    forces, positions = ([f"{corner}.{what}" for corner in _CORNERS] for what in ("aero", "aero_position"))
    if not set(forces + positions) <= set(columns):
        return found
    F, X = np.stack([columns[n] for n in forces]), -np.stack([columns[n] for n in positions])
    moved = np.linalg.svd(X - X.mean(axis=1, keepdims=True), compute_uv=False)
    if X.shape[1] <= len(X) or moved[-1] < _MOVED * moved[0]:
        return found
    solved = np.stack([_affine(X, row) for row in F])
    K, zero = solved[:, :-1], solved[:, -1]
    left = np.std(F - K @ X - zero[:, None], axis=1) / np.std(F, axis=1)
    return replace(found, stiffness=K, zero_force=zero, modal=_modal(columns), unexplained=left)


def _modal(columns: Mapping[str, Array]) -> Array | None:
    """Return K_m from the mode channels, which are the aeroloaders' by T_x and T_f (6.1, 6.2)."""
    moved = [f"aero.{mode}" for mode in MODES]
    pushed = ["aero.heave_force", *(f"aero.{mode}_moment" for mode in MODES[1:])]
    if not set(moved + pushed) <= set(columns):
        return None
    X = np.stack([columns[name] for name in moved])
    return np.stack([_affine(X, columns[name])[:-1] for name in pushed])


def _affine(X: Array, y: Array, *, least: float = 1e-6) -> Array:
    """Return a and b (n + 1,) of `y = a X + b` for X (n, H), in scaled columns.

    A way of X that moves by less than `least` of the strongest counts as not moved [1].
    """
    size = np.maximum(np.abs(X).max(axis=1), 1e-300)
    design = np.vstack((X / size[:, None], np.ones(X.shape[1]))).T
    solved = np.linalg.lstsq(design, y, rcond=least)[0]
    return np.asarray(solved / np.append(size, 1.0))


def _until_lifted(levels: Array, names: Sequence[str]) -> int:
    """Return how many levels (H, channels) there are until a tire leaves the ground: it lands elsewhere.

    Forces that are changes from rest, and go below zero, cannot say it.
    """
    tires = levels[:, [name.rpartition(".")[2] == "tire_force" for name in names]]
    none = _LIFTED * np.abs(tires).max(initial=0.0)
    whole = tires[:, (tires >= -none).all(axis=0)]
    lifted = np.flatnonzero((whole <= none).any(axis=1))
    return int(lifted[0]) if lifted.size else len(levels)


def _levels(record: TimeSeries, names: Sequence[str], loads: Sequence[str]) -> Array:
    """Return the mean of every channel over every level that is held (H, channels)."""
    rows = np.stack([record[name] for name in loads])
    spans = holds(rows - rows.mean(axis=1, keepdims=True), record.sample_rate)
    table = [[float(record[name][span].mean()) for name in names] for span in spans]
    return np.array(table).reshape(-1, len(names))
