"""A run of any setups of a car on one drive, in the form of fmus/machine/machine.h, and its batches of setups."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Integers
from eightpost.machine.car import (
    Drive,
    FilterStructure,
    Library,
    LimitStructure,
    LinearCar,
    NotInBatchError,
    QuantityStructure,
    RunStructure,
    ShockData,
    SignalStructure,
    SumsStructure,
    compiled,
)

#: Signals of a shock, in the order of fmus/machine/port.h.
SIGNALS = ("force", "static_force", "lagged_force", "lag_weight", "dissipated_power", "beyond_fit")

#: Number of the velocity of a port there, which is also an output of the vehicle.
_VELOCITY = len(SIGNALS)

#: Largest numbers of limits, recorded channels and quantities of fmus/machine/march.h.
_MOST_LIMITS, _MOST_CHANNELS, _MOST_QUANTITIES = 8, 256, 512

#: A library that is loaded again is the same one.
_loaded = lru_cache(maxsize=8)(Library)

#: Number of times that the ports are evaluated in a step; with friction at a port, once more.
_SWEEPS = 2


@dataclass(frozen=True, slots=True)
class Quantity:
    """A weighted sum of channels, or the product of two, whose statistics are summed over some recorded rows."""

    channels: tuple[str, ...]  #: Names of the channels.
    weights: tuple[float, ...]  #: Factor for each channel.
    rows: tuple[int, int]  #: First recorded row, and the one after the last.
    product: bool = False  #: Whether the channels are multiplied.
    #: Limits of the values that are counted: from the first up to, but not including, the second.
    inside: tuple[float, float] = (-np.inf, np.inf)
    limits: bool = False  #: Whether the smallest and the largest value and the number inside are needed.

    def structure(self, first: int = 0) -> Any:
        """Return the structure Quantity of fmus/machine/machine.h; `first` is the place of its first term."""
        options = (int(self.product), *self.rows, int(self.limits), *self.inside)
        return QuantityStructure(first, len(self.channels), *options)


class Limit(NamedTuple):
    """A limit of an output of the vehicle, exceeded where sign * output > limit."""

    sign: float
    limit: float
    output: int


class Run:
    """A run of all setups on one drive.

    Args:
        car: Vehicle around dampers at the shocks' ports.
        drive: Drive and steps.
        channels: Channels by name: (-1, number of an output of the vehicle), or (port, place in SIGNALS).
        quantities: Quantities whose statistics are summed.
        limits: Limits that are watched.
        series: Names of the channels whose series are stored.
        settling: Number of records at the start that limits do not count.
        single: Whether numbers are in single precision.

    Attributes:
        structure: Structure Run of fmus/machine/machine.h.
        rows: Times of the records (R,) [s].
        library: Compiled library.

    Raises:
        NotInBatchError: There is too much to record, or the car has no steady state.
        FmuError: There is no compiler, or it fails.
    """

    def __init__(
        self,
        car: LinearCar,
        drive: Drive,
        channels: Mapping[str, tuple[int, int]],
        *,
        quantities: Sequence[Quantity] = (),
        limits: Sequence[Limit] = (),
        series: Sequence[str] = (),
        settling: int = 0,
        single: bool = False,
    ) -> None:
        self._arrays: list[Any] = []
        self.corners, self.limits = len(car.ports), tuple(limits)
        self.series, self.quantities = tuple(series), tuple(quantities)
        self.rows, self.settling = drive.times[:: drive.every], settling
        self.steps, step = drive.times.size - 1, float(drive.times[1] - drive.times[0])
        names = tuple(dict.fromkeys([*(c for q in quantities for c in q.channels), *series]))
        if len(limits) > _MOST_LIMITS or len(names) > _MOST_CHANNELS or len(quantities) > _MOST_QUANTITIES:
            raise NotInBatchError("it has too many measures")
        sweeps = _SWEEPS + any(port.has_forces for port in car.ports)
        self.library = _loaded(compiled(car.pairs, self.corners, sweeps=sweeps, single=single))
        # the sweeps have found the velocities of the ports, which need no row of outputs
        places_of = {(-1, port.velocity): (k, _VELOCITY) for k, port in enumerate(car.ports)}
        channels = {name: places_of.get(channels[name], channels[name]) for name in names}
        own = dict.fromkeys(number for name in names for corner, number in (channels[name],) if corner < 0)
        outputs = list(own | dict.fromkeys(limit.output for limit in limits))
        signals = list(dict.fromkeys(channels[name] for name in names if channels[name][0] >= 0))
        places = {name: self._place(outputs, signals, *channels[name]) for name in names}
        velocities, travels, recorded = self._by_drive(car, drive, outputs)
        self.structure = RunStructure(
            car=self._numbers(car.data(step)),
            velocities=self._numbers(velocities),
            travels=self._numbers(travels),
            outputs=self._numbers(recorded),
            output_rows=self._numbers(car.output_rows(outputs, step)),
            signals=self._structures(SignalStructure(*signal) for signal in signals),
            quantities=self._structures(self._quantities()),
            terms=self._integers(places[c] for q in quantities for c in q.channels),
            weights=self._numbers(np.array([w for q in quantities for w in q.weights])),
            limits=self._structures(LimitStructure(sign, at, outputs.index(row)) for sign, at, row in limits),
            series=self._integers(places[name] for name in series),
            step=step,
            steps=self.steps,
            every=drive.every,
            settling=settling,
            output_count=len(outputs),
            signal_count=len(signals),
            quantity_count=len(quantities),
            limit_count=len(limits),
            series_count=len(series),
        )

    @staticmethod
    def _place(outputs: Sequence[int], signals: Sequence[tuple[int, int]], corner: int, number: int) -> int:
        """Return the place of a channel: signals of shocks follow the outputs of the vehicle."""
        return outputs.index(number) if corner < 0 else len(outputs) + signals.index((corner, number))

    def _by_drive(self, car: LinearCar, drive: Drive, outputs: Sequence[int]) -> tuple[Array, Array, Array]:
        """Return what the drive does: velocities and travels of the ports (K + 1, C), and outputs at records (R, O)."""
        velocities = [port.velocity for port in car.ports]
        travels = [port.velocity if port.travel is None else port.travel for port in car.ports]
        wanted, count = np.searchsorted(drive.points, drive.times), self.corners
        ports = car.by_drive(drive, wanted, [*velocities, *travels], self.library)
        ports[:, [count + k for k, port in enumerate(car.ports) if port.travel is None]] = 0.0
        recorded = car.by_drive(drive, wanted[:: drive.every], outputs, self.library)
        return ports[:, :count], ports[:, count:], recorded

    def _quantities(self) -> Iterable[Any]:
        first = 0
        for q in self.quantities:
            yield q.structure(first)
            first += len(q.channels)

    # ---- Arrays that live as long as the run ------------------------------------------------------------------------

    def _address(self, array: NDArray[Any]) -> int:
        array = np.ascontiguousarray(array)
        self._arrays.append(array)
        return int(array.ctypes.data)

    def _numbers(self, array: Array) -> int:
        return self._address(array.astype(self.library.number))

    def _integers(self, values: Iterable[int]) -> int:
        return self._address(np.array(list(values), dtype=np.int32))

    def _structures(self, values: Iterable[Any]) -> int:
        found = list(values)
        array = (type(found[0]) * len(found))(*found) if found else (ctypes.c_int * 1)()
        self._arrays.append(array)
        return ctypes.addressof(array)


# ==== Batches: several setups at once, one in each lane ==============================================================

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
        self._space = _aligned((run.library.size,), np.dtype(np.uint8))
        self._parameters = self._aligned((corners, run.library.parameters))
        self._laws = self._aligned((corners,), run.library.integer)
        shapes: Mapping[str, tuple[int, ...]] = {
            "transferred": (corners,),
            "residual": (corners,),
            "defect": (2, corners),
            "total": (2, corners),
            "squares": (2, corners),
            "beyond": (corners,),
            "watched": (len(run.limits),),
            "statistics": (len(run.quantities), len(STATISTICS)),
        }
        self._sums = {name: self._aligned(shape, np.float64) for name, shape in shapes.items()}
        self._sums["values"] = self._aligned((run.rows.size, len(run.series)))
        self._ended = np.zeros(self.lanes, np.int64)
        self._filtered: dict[tuple[str, Any], Array] = {}

    def _aligned(self, shape: tuple[int, ...], of: Any = None) -> NDArray[Any]:
        return _aligned((*shape, self.lanes), np.dtype(of or self._library.number))

    def filtered(self, name: str, sections: Any) -> Array:
        """Return a recorded channel of the last run through a filter, forward and backward (R, lanes).

        The array is overwritten when the same channel of another run is filtered. `sections` has second-order sections
        `rows` (S, 6), their state `rest` for a unit step (S, 2), and `pad` samples of odd reflection at each end.
        """
        rows, rest = np.ascontiguousarray(sections.rows), np.ascontiguousarray(sections.rest)
        given = FilterStructure(rows.ctypes.data, rest.ctypes.data, len(rows), sections.pad)
        series, count = self._sums["values"], self._run.rows.size
        if (name, sections) not in self._filtered:
            self._filtered[name, sections] = self._aligned((count + 2 * sections.pad,), np.float64)
        space = self._filtered[name, sections]
        column = self._run.series.index(name)
        self._library.call(
            "filter_series", given, series.ctypes.data, len(self._run.series), column, count, space.ctypes.data
        )
        return space.reshape(-1).view(series.dtype)[: count * self.lanes].reshape(count, self.lanes)

    def statistics_of(self, quantity: Quantity, columns: Sequence[Array]) -> Array:
        """Return the statistics (8, lanes) of a quantity of filtered channels, each of (R, lanes)."""
        given, weights = quantity.structure(), np.array(quantity.weights, self._library.number)
        addresses = (ctypes.c_void_p * len(columns))(*(column.ctypes.data for column in columns))
        found = self._aligned((len(STATISTICS),), np.float64)
        self._library.call("sum_series", given, ctypes.addressof(addresses), weights.ctypes.data, found.ctypes.data)
        return found

    def run(self, setups: Sequence[Sequence[ShockData]]) -> BatchResult:
        """Run up to as many setups as there are lanes; each is a shock per port, in the order of the car's.

        The result's arrays are overwritten by the next run.
        """
        count = len(setups)
        filled = [*setups, *[setups[0]] * (self.lanes - count)]
        self._parameters[:] = np.array([[shock.parameters for shock in s] for s in filled]).transpose(1, 2, 0)
        self._laws[:] = np.array([[shock.law for shock in s] for s in filled]).T
        sums = {name: array.ctypes.data for name, array in self._sums.items()}
        addresses = [array.ctypes.data for array in (self._parameters, self._laws, self._space)]
        self._library.call(
            "run_machine", self._run.structure, *addresses, SumsStructure(**sums, ended=self._ended.ctypes.data)
        )
        own = {name: array[..., :count] for name, array in self._sums.items()}
        return BatchResult(**own, ended=self._ended[:count])


def _aligned(shape: tuple[int, ...], of: np.dtype[Any]) -> NDArray[Any]:
    """Return zeros at an address that is a multiple of 64."""
    size = int(np.prod(shape)) * of.itemsize
    raw = np.zeros(size + 64, np.uint8)
    first = -raw.ctypes.data % 64
    return raw[first : first + size].view(of).reshape(shape)
