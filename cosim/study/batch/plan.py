"""A run of all setups of a study on one drive, in the form of fmus/batch/batch.h."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.components.component import Conversion, to_si
from cosim.session.session import grid_of
from cosim.session.setup import Setup
from cosim.study.batch import library
from cosim.study.batch.car import CarData
from cosim.study.batch.reasons import NotInBatchError
from cosim.systems.algorithm import GaussSeidel
from cosim.systems.coupling import Feed, Term
from cosim.systems.system import System

#: Signals of a shock, in the order of PortSignals in fmus/batch/port.h.
_SIGNALS = ("force", "static_force", "lagged_force", "lag_weight", "dissipated_power", "beyond_fit")

#: Largest numbers of limits, recorded channels and quantities of fmus/batch/march.h.
_MOST_LIMITS, MOST_CHANNELS, MOST_QUANTITIES = 8, 256, 512


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
        """Return the structure Quantity of fmus/batch/batch.h; `first` is the place of its first term."""
        options = (int(self.product), *self.rows, int(self.limits), *self.inside)
        return library.Quantity(first, len(self.channels), *options)


class Plan:
    """A run of all setups on one drive.

    Args:
        setup: Run of one of the setups.
        vehicle: Name of the vehicle's component.
        car: Data of the vehicle.
        quantities: Quantities whose statistics are needed.
        series: Names of the channels whose series are needed.

    Attributes:
        run: Structure Run of fmus/batch/batch.h.
        rows: Times of the recorded rows (R,) [s].

    Raises:
        NotInBatchError: The run is not one of a vehicle with shocks at its ports by the default scheme.
    """

    def __init__(
        self, setup: Setup, vehicle: str, car: CarData, quantities: Sequence[Quantity], series: Sequence[str]
    ) -> None:
        self.corners = tuple(bond.name for bond in setup.system.bonds)
        self._car, self._vehicle, self._system = car, vehicle, setup.system
        self._arrays: list[Any] = []
        _check(setup, vehicle)
        grid = grid_of(setup)
        recorded = np.flatnonzero(setup.recorded)
        self.rows: NDArray[np.float64] = setup.times[recorded]
        self.limits = tuple(limit for limit in setup.limits.watched if limit.signal.startswith(f"{vehicle}."))
        self.series, self.quantities = tuple(series), tuple(quantities)
        self._channels = tuple(dict.fromkeys([*(c for q in quantities for c in q.channels), *series]))
        if len(self.limits) > _MOST_LIMITS or len(self._channels) > MOST_CHANNELS or len(quantities) > MOST_QUANTITIES:
            raise NotInBatchError("it has too many measures")
        drive = grid.drive
        self._scenario = setup.scenario
        self.run = library.Run(
            car=self._address(np.frombuffer(car.data, dtype=np.uint8)),
            inputs=self._structures(map(self._input, setup.coupling.feeds[vehicle])),
            velocity_output=self._integers(self._output(bond.velocity.source) for bond in setup.system.bonds),
            displacement_output=self._integers(self._displacement(bond) for bond in setup.system.bonds),
            times=self._address(setup.times),
            steps=self._address(grid.steps),
            recorded=self._address(setup.recorded.astype(np.int64)),
            begins=self._address(np.asarray(grid.begins, dtype=np.int64)),
            drive_times=self._address(drive.times),
            samples=self._address(drive.samples),
            starts=self._address(drive.starts),
            first_drive=self._address(self._first_drive()),
            recorded_channels=self._structures(map(self._channel, self._channels)),
            quantities=self._structures(self._quantities()),
            terms=self._integers(self._channels.index(c) for q in quantities for c in q.channels),
            weights=self._address(np.array([w for q in quantities for w in q.weights], dtype=np.float64)),
            limits=self._structures(
                library.Limit(limit.sign, limit.limit, self._output(limit.signal)) for limit in self.limits
            ),
            series_channels=self._integers(map(self._channels.index, series)),
            settling=setup.scenario.settling,
            steps_count=setup.times.size - 1,
            drive_channels=drive.samples.shape[1],
            follows=int(vehicle in setup.following),
            channel_count=len(self._channels),
            quantity_count=len(quantities),
            limit_count=len(self.limits),
            series_count=len(series),
        )

    # ---- Numbers of channels ----------------------------------------------------------------------------------------

    def _output(self, name: str) -> int:
        component, _, variable = name.partition(".")
        if component != self._vehicle or variable not in self._car.outputs:
            raise NotInBatchError(f"{name} is not an output of the vehicle")
        _check_si(self._system, name)
        return self._car.outputs.index(variable)

    def _displacement(self, bond: Any) -> int:
        if bond.displacement is None:
            raise NotInBatchError(f"the shock at {bond.name} has no displacement")
        return self._output(bond.displacement.source)

    def _channel(self, name: str) -> Any:
        component, _, variable = name.partition(".")
        if component == self._vehicle:
            return library.Channel(-1, self._output(name))
        if component not in self.corners or variable not in _SIGNALS:
            raise NotInBatchError(f"{name} is not recorded in a batch")
        _check_si(self._system, name)
        return library.Channel(self.corners.index(component), _SIGNALS.index(variable))

    def _input(self, feed: Feed) -> Any:
        corner, channel, conversion = -1, -1, Conversion()
        if feed.terms:
            corner = self._corner_of(feed.terms)
        if feed.drive is not None:
            channel, conversion = feed.drive, feed.drive_conversion
        return library.Input(feed.constant, conversion.factor, conversion.offset, corner, channel)

    def _corner_of(self, terms: Sequence[Term]) -> int:
        source, _, variable = terms[0].source.partition(".")
        if len(terms) > 1 or variable != "force" or source not in self.corners:
            raise NotInBatchError("an input of the vehicle has other sources than a shock and the drive")
        _check_unscaled(terms)
        return self.corners.index(source)

    def _quantities(self) -> Iterable[Any]:
        first = 0
        for q in self.quantities:
            yield q.structure(first)
            first += len(q.channels)

    def _first_drive(self) -> NDArray[np.float64]:
        scenario = self._scenario
        if scenario.drive is None:
            return np.zeros(0)
        return np.ascontiguousarray(scenario.drive.sample(np.array([scenario.drive_start]))[:, 0])

    # ---- Arrays that live as long as the plan -----------------------------------------------------------------------

    def _address(self, array: NDArray[Any]) -> int:
        array = np.ascontiguousarray(array)
        self._arrays.append(array)
        return int(array.ctypes.data)

    def _integers(self, values: Iterable[int]) -> int:
        return self._address(np.array(list(values), dtype=np.int32))

    def _structures(self, values: Iterable[Any]) -> int:
        found = list(values)
        array = (type(found[0]) * len(found))(*found) if found else (ctypes.c_int * 1)()
        self._arrays.append(array)
        return ctypes.addressof(array)


def _check(setup: Setup, vehicle: str) -> None:
    if not isinstance(setup.algorithm, GaussSeidel) or setup.algorithm.values != "parabolic":
        raise NotInBatchError(f"the coupling scheme is {setup.algorithm.name}")
    if setup.discrete.is_needed or setup.system.connections:
        raise NotInBatchError("components have connections besides their bonds")
    if setup.layout.parts[0] != vehicle or len(setup.layout.levels) != 1 or len(setup.layout.levels[0]) != 2:
        raise NotInBatchError("the vehicle is not stepped before its shocks")
    for bond in setup.system.bonds:
        for feed in setup.coupling.feeds[bond.name]:
            if len(feed.terms) != 1 or feed.drive is not None or feed.constant != 0.0:
                raise NotInBatchError(f"an input of the shock at {bond.name} has other sources than the vehicle")
            _check_unscaled(feed.terms)


def _check_unscaled(terms: Iterable[Term]) -> None:
    if any(term.gain != 1.0 or term.conversion != Conversion() for term in terms):
        raise NotInBatchError("a connection has a gain or converts a unit")


def _check_si(system: System, name: str) -> None:
    if to_si(system.output(name))[0] != Conversion():
        raise NotInBatchError(f"{name} is not in an SI unit")
