"""Runs of several setups at once, one in each lane."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Integers
from eightpost.machine import library
from eightpost.machine.run import Quantity, Run
from eightpost.machine.shocks import ShockData

#: Names of the statistics of a quantity, in the order of fmus/machine/machine.h.
STATISTICS = ("shift", "sum", "squares", "least", "largest", "inside", "first", "last")


@dataclass(frozen=True, slots=True, eq=False)
class BatchResult:
    """Sums of one batch of n setups. C corners, W limits, Q quantities, S channels, R rows."""

    transferred: Array  #: Work through each bond, without its sign [J] (C, n).
    residual: Array  #: Work that the coupling added at each corner [J] (C, n).
    defect: Array  #: Squared defects of velocities and forces, over the steps (2, C, n).
    total: Array  #: Velocities and forces, over the steps (2, C, n).
    squares: Array  #: Squares of velocities and forces, over the steps (2, C, n).
    beyond: Array  #: Records beyond the fit of each shock (C, n).
    watched: Array  #: Records beyond each limit (W, n).
    statistics: Array  #: Statistics of each quantity (Q, 8, n).
    values: Array  #: Recorded channels (R, S, n).
    ended: Integers  #: Step at which a setup was retired; -1 for none (n,).

    def kept(self, statistics: Sequence[Array]) -> BatchResult:
        """Return a copy that the next run does not overwrite, without series and with further statistics."""
        arrays = {name: array.copy() for name, array in self._arrays().items()}
        more = {"statistics": np.array([*self.statistics, *statistics]), "values": self.values[:0].copy()}
        return replace(self, **(arrays | more))

    def _arrays(self) -> dict[str, Array]:
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, np.ndarray) and name != "values"}


def joined(results: Sequence[BatchResult]) -> BatchResult:
    """Return the sums of several batches of a run as those of one, without series."""
    arrays = [result._arrays() for result in results]
    together: dict[str, Any] = {name: np.concatenate([own[name] for own in arrays], axis=-1) for name in arrays[0]}
    return replace(results[0], **together)


class Batch:
    """Memory for batches of a run, used again and again.

    Args:
        run: Run of all setups.
    """

    def __init__(self, run: Run) -> None:
        self._library, self._run = run.library, run
        corners, self.lanes = run.corners, run.library.setups
        self._space = _aligned((run.library.size + 7) // 8)
        self._parameters = _aligned(corners * run.library.parameters * self.lanes)
        self._laws = np.zeros((corners, self.lanes), np.int64)
        shapes: Mapping[str, tuple[int, ...]] = {
            "transferred": (corners,),
            "residual": (corners,),
            "defect": (2, corners),
            "total": (2, corners),
            "squares": (2, corners),
            "beyond": (corners,),
            "watched": (len(run.limits),),
            "statistics": (len(run.quantities), len(STATISTICS)),
            "values": (run.rows.size, len(run.series)),
        }
        self._sums = {name: _aligned_lanes(shape, self.lanes) for name, shape in shapes.items()}
        self._ended = np.zeros(self.lanes, np.int64)
        self._filtered: dict[tuple[str, Any], Array] = {}

    def filtered(self, name: str, sections: Any) -> Array:
        """Return a recorded channel of the last run through a filter, forward and backward (R, lanes).

        The array is overwritten when the same channel of another run is filtered. `sections` has second-order sections
        `rows` (S, 6), their state `rest` for a unit step (S, 2), and `pad` samples of odd reflection at each end.
        """
        rows, rest = np.ascontiguousarray(sections.rows), np.ascontiguousarray(sections.rest)
        given = library.Filter(rows.ctypes.data, rest.ctypes.data, len(rows), sections.pad)
        series, count = self._sums["values"], self._run.rows.size
        if (name, sections) not in self._filtered:
            self._filtered[name, sections] = _aligned_lanes((count + 2 * sections.pad,), self.lanes)
        space = self._filtered[name, sections]
        column = self._run.series.index(name)
        self._library.call(
            "filter_series", given, series.ctypes.data, len(self._run.series), column, count, space.ctypes.data
        )
        return space[sections.pad : sections.pad + count]

    def statistics_of(self, quantity: Quantity, columns: Sequence[Array]) -> Array:
        """Return the statistics (8, lanes) of a quantity of filtered channels, each of (R, lanes)."""
        given, weights = quantity.structure(), np.array(quantity.weights)
        addresses = (ctypes.c_void_p * len(columns))(*(column.ctypes.data for column in columns))
        found = _aligned_lanes((len(STATISTICS),), self.lanes)
        self._library.call("sum_series", given, ctypes.addressof(addresses), weights.ctypes.data, found.ctypes.data)
        return found

    def run(self, setups: Sequence[Sequence[ShockData]]) -> BatchResult:
        """Run up to as many setups as there are lanes; each is a shock per port, in the order of the car's.

        The result's arrays are overwritten by the next run.
        """
        count = len(setups)
        filled = [*setups, *[setups[0]] * (self.lanes - count)]
        parameters = self._parameters.reshape(self._run.corners, -1, self.lanes)
        for lane, shocks in enumerate(filled):
            for corner, shock in enumerate(shocks):
                parameters[corner, :, lane] = shock.parameters
                self._laws[corner, lane] = shock.law
        sums = {name: array.ctypes.data for name, array in self._sums.items()}
        addresses = [array.ctypes.data for array in (parameters, self._laws, self._space)]
        self._library.call(
            "run_machine", self._run.structure, *addresses, library.Sums(**sums, ended=self._ended.ctypes.data)
        )
        own = {name: array[..., :count] for name, array in self._sums.items()}
        return BatchResult(**own, ended=self._ended[:count])


def _aligned(count: int) -> NDArray[np.float64]:
    """Return zeros (count,) at an address that is a multiple of 64."""
    raw = np.zeros(count + 8)
    first = (-raw.ctypes.data // 8) % 8
    return raw[first : first + count]


def _aligned_lanes(shape: tuple[int, ...], lanes: int) -> NDArray[np.float64]:
    return _aligned(int(np.prod(shape)) * lanes).reshape(*shape, lanes)
