"""Static rating of a car on an 8-post rig: its spring matrix, and its tire forces at zero load (6.4.4).

    F_aero = K X_aero + F_zero          (6.10)
    K_m = T_f K T_x^-1                  (6.11)

F and X are forces and positions of the aeroloaders, positive down and averaged over every level that is held; K_m
relates the forces of the modes to their displacements. The tire forces and ride heights at zero load, also found by
least squares over the loads, are the static state of a vehicle file.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import InputError
from eightpost.ident.preparation import Decimation, Preparation, prepare
from eightpost.rig import RigTest
from eightpost.rig.geometry import MODES
from eightpost.signals import TimeSeries
from eightpost.units import convert

#: Quantities with a static value, by the last part of the channel name.
_STATIC = ("tire_force", "ride_height")

#: Tire force, relative to the largest at any level, below which a tire has left the ground [1].
_LIFTED = 0.01

#: Sampling rate to which static records are decimated [Hz].
_RATE = 125.0

#: Ratio of the smallest to the largest singular value of the loads below which a direction was not moved [1].
_MOVED = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class StaticRating:
    """Result of static records."""

    levels: int  #: Number of levels that were held with all tires on the ground.
    #: Number of levels that were left out: those of a record from the first one at which a tire carries no load.
    lifted: int
    loads: tuple[str, ...]  #: Names of the loads.
    zero: Mapping[str, float]  #: Tire forces and ride heights at zero load, SI, by channel.
    #: Spring matrix K by aeroloader [N/m] (4, 4); None if the loads were not moved in all four modes.
    stiffness: Array | None = None
    zero_force: Array | None = None  #: Force F_zero [N] (4,); None like `stiffness`.
    #: Spring matrix K_m in heave, pitch, roll, warp [N/m, N/rad, N.m/m, N.m/rad] (4, 4); None like `stiffness`.
    modal: Array | None = None
    #: RMS of the part of each aeroloader's force that K does not explain, relative to the RMS of the force [1] (4,);
    #: None like `stiffness`.
    unexplained: Array | None = None

    def summary(self, outputs: Collection[str]) -> str:
        """Return a sentence about the static state of a vehicle with these outputs."""
        static = {name: value for name, value in self.zero.items() if name in outputs}
        tires = [f"{n.rpartition('.')[0]} {convert(v, 'N', 'lbf'):.0f}" for n, v in static.items() if "tire" in n]
        heights = [f"{n.rpartition('.')[0]} {convert(v, 'm', 'in'):.3f}" for n, v in static.items() if "height" in n]
        lifted = f" ({self.lifted} more left out, at which a tire carries no load)" if self.lifted else ""
        text = f"static state at zero load, from {self.levels} levels{lifted}: tires {', '.join(tires)} lbf"
        return f"{text}; ride heights {', '.join(heights)} in" if heights else text

    @property
    def modal_us(self) -> dict[str, list[float]]:
        """Spring matrix K_m as in Eq 6.11: a row for each mode's force [1e3 lbf, lbf.ft] per displacement [in, deg]."""
        if self.modal is None:
            return {}
        force = [convert(1.0, "N", "lbf"), *[convert(1.0, "N.m", "lbf.ft")] * 3]
        moved = [convert(1.0, "m", "in"), *[convert(1.0, "rad", "deg")] * 3]
        return {
            mode: [1e-3 * value * unit / step for value, step in zip(row, moved, strict=True)]
            for mode, row, unit in zip(MODES, self.modal, force, strict=True)
        }


def rate_tests(tests: Iterable[RigTest], loads: Sequence[str]) -> StaticRating:
    """Return the static rating of a car from static tests, which are decimated first; see `rate_statically`."""
    records = []
    for test in tests:
        prepared = prepare([test], Preparation(Decimation(_RATE)))
        series = prepared.records[0]
        for name, mean in prepared.means[0].items():
            series = series.with_channel(name, series.unit(name), series[name] + mean)
        records.append(series)
    return rate_statically(records, loads)


def rate_statically(records: Sequence[TimeSeries], loads: Sequence[str]) -> StaticRating:
    """Return the static rating of a car from its static records.

    The records have their means, at any sample rate; loads step from level to level, and roads are at rest.

    Raises:
        InputError: The records hold fewer than two levels, or have no load in common.
    """
    common = tuple(name for name in loads if all(name in record for record in records))
    if not common:
        raise InputError(
            f"the static records have none of the loads {', '.join(loads)}; give records with at least one of them"
        )
    names = [n for n in records[0].names if all(n in r for r in records)]
    held = [_levels(record, names, common) for record in records]
    table = np.concatenate([levels[: _until_lifted(levels, names)] for levels in held])
    if len(table) < 2:
        raise InputError(
            f"the static records hold {len(table)} levels of {', '.join(common)} with all tires on the ground, but two "
            "are needed; give records that hold each level for some seconds (6.1.3)"
        )
    columns = dict(zip(names, table.T, strict=True))
    force = np.stack([columns[name] for name in common])
    static = [name for name in names if name.rpartition(".")[2] in _STATIC]
    zero = {name: _affine(force, columns[name], cutoff=_MOVED)[-1] for name in static}
    lifted = sum(map(len, held)) - len(table)
    found = StaticRating(len(table), lifted, common, {name: float(value) for name, value in zero.items()})
    return _with_springs(found, columns)


def _with_springs(found: StaticRating, columns: Mapping[str, Array]) -> StaticRating:
    """Add the spring matrix if four aeroloaders and their positions were moved in all modes."""
    forces, positions = ([f"{corner}.{what}" for corner in CORNERS] for what in ("aero", "aero_position"))
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
    """Return K_m from the mode channels, which follow from the aeroloaders by T_x and T_f (6.1, 6.2)."""
    moved = [f"aero.{mode}" for mode in MODES]
    pushed = ["aero.heave_force", *(f"aero.{mode}_moment" for mode in MODES[1:])]
    if not set(moved + pushed) <= set(columns):
        return None
    X = np.stack([columns[name] for name in moved])
    return np.stack([_affine(X, columns[name])[:-1] for name in pushed])


def _affine(X: Array, y: Array, *, cutoff: float = 1e-6) -> Array:
    """Return a and b (n + 1,) of `y = a X + b` for X (n, H), computed with scaled columns.

    A direction of X with a singular value below `cutoff` times the largest [1] counts as not moved.
    """
    size = np.maximum(np.abs(X).max(axis=1), 1e-300)
    design = np.vstack((X / size[:, None], np.ones(X.shape[1]))).T
    solved = np.linalg.lstsq(design, y, rcond=cutoff)[0]
    return np.asarray(solved / np.append(size, 1.0))


def _until_lifted(levels: Array, names: Sequence[str]) -> int:
    """Return the number of levels (H, channels) before a tire leaves the ground, as it may land in another place.

    Forces that become negative are changes from rest and cannot show it.
    """
    tires = levels[:, [name.rpartition(".")[2] == "tire_force" for name in names]]
    limit = _LIFTED * np.abs(tires).max(initial=0.0)
    absolute = tires[:, (tires >= -limit).all(axis=0)]
    lifted = np.flatnonzero((absolute <= limit).any(axis=1))
    return int(lifted[0]) if lifted.size else len(levels)


def _levels(record: TimeSeries, names: Sequence[str], loads: Sequence[str]) -> Array:
    """Return the mean of every channel (columns) over every level that is held (rows)."""
    rows = np.stack([record[name] for name in loads])
    spans = holds(rows - rows.mean(axis=1, keepdims=True), record.sample_rate)
    table = [[float(record[name][span].mean()) for name in names] for span in spans]
    return np.array(table).reshape(-1, len(names))


# ---- Detection of the intervals in which stepped loads are held constant --------------------------------------------

#: Loads are held if they change by less than `_STILL` of their range within `_LOOK` [s], for at least `_SHORTEST` [s].
_STILL, _LOOK, _SHORTEST = 0.01, 0.2, 1.0


def holds(rows: Array, rate: float) -> list[slice]:
    """Return the second half of every hold of loads (A, N) at a rate [Hz], when oscillations have decayed."""
    look = max(1, round(_LOOK * rate))
    change = np.abs(rows[:, look:] - rows[:, :-look]).max(axis=0)
    still = np.concatenate(([False], change <= _STILL * np.ptp(rows, axis=1).max(), [False]))
    edges = np.flatnonzero(np.diff(still.astype(int)))
    spans = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST * rate]
    return [slice((start + stop) // 2, stop) for start, stop in spans]
