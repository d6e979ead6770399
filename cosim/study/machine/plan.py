"""A run of all setups of a study on one drive, in the form of fmus/machine/machine.h."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.components.conversion import Conversion, to_si
from cosim.session.setup import Setup
from cosim.session.step_times import joined
from cosim.study.machine import library
from cosim.study.machine.car import Vehicle
from cosim.study.machine.library import Library, compiled
from cosim.study.machine.linear import Bond, LinearCar
from cosim.study.machine.reasons import NotInBatchError
from cosim.systems.coupling import Feed, Term
from cosim.systems.system import System
from eightpost.array_types import Array

#: Signals of a shock, in the order of PortSignals in fmus/machine/port.h.
_SIGNALS = ("force", "static_force", "lagged_force", "lag_weight", "dissipated_power", "beyond_fit")

#: Largest numbers of limits, recorded channels and quantities of fmus/machine/march.h.
_MOST_LIMITS, MOST_CHANNELS, MOST_QUANTITIES = 8, 256, 512

#: Number of times that the ports are evaluated in a step; with friction at a port, once more.
_SWEEPS = 2

#: Friction of a port without any, in the order of PortFriction in fmus/machine/car.h.
_FREE = (0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0)


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
        return library.Quantity(first, len(self.channels), *options)


class Plan:
    """A run of all setups on one drive at one step.

    Args:
        setup: Run of one of the setups; its step divides the interval between records.
        name: Name of the vehicle's component.
        vehicle: Vehicle.
        damping: Linear damping at each shock's port, around which the ports are solved (C,) [N.s/m].
        quantities: Quantities whose statistics are needed.
        series: Names of the channels whose series are needed.
        width: Instruction set; None: the widest of this processor.

    Attributes:
        run: Structure Run of fmus/machine/machine.h.
        rows: Times of the recorded rows (R,) [s].
        library: Compiled library.

    Raises:
        NotInBatchError: The run is not one of a vehicle with shocks at its ports.
        FmuError: There is no compiler, or it fails.
    """

    def __init__(
        self,
        setup: Setup,
        name: str,
        vehicle: Vehicle,
        damping: Array,
        quantities: Sequence[Quantity],
        series: Sequence[str],
        *,
        width: str | None = None,
    ) -> None:
        self.corners = tuple(bond.name for bond in setup.system.bonds)
        self._vehicle, self._name, self._system = vehicle, name, setup.system
        self._arrays: list[Any] = []
        _check(setup)
        feeds = setup.coupling.feeds[name]
        bonds = [self._bond(bond, feeds) for bond in setup.system.bonds]
        car = LinearCar.of(vehicle, bonds, damping)
        friction = self._friction(bonds)
        sweeps = _SWEEPS + any(map(_has_forces, friction))
        self.library = Library(compiled(car.pairs, len(bonds), sweeps=sweeps, width=width))
        times, every = _regular(setup)
        self.rows: NDArray[np.float64] = times[::every]
        self.limits = tuple(limit for limit in setup.limits.watched if limit.signal.startswith(f"{name}."))
        self.series, self.quantities = tuple(series), tuple(quantities)
        self._channels = tuple(dict.fromkeys([*(c for q in quantities for c in q.channels), *series]))
        own = [c for c in self._channels if c.startswith(f"{name}.")]
        self._outputs = [self._output(c) for c in dict.fromkeys([*own, *(limit.signal for limit in self.limits)])]
        if len(self.limits) > _MOST_LIMITS or len(self._channels) > MOST_CHANNELS or len(quantities) > MOST_QUANTITIES:
            raise NotInBatchError("it has too many measures")
        velocities, travels, outputs = self._by_drive(car, setup, times, every)
        rows, direct = car.output_rows(self._outputs)
        self.run = library.Run(
            car=self._address(np.frombuffer(car.data(float(times[1] - times[0]), friction), dtype=np.uint8)),
            velocities=self._address(velocities),
            travels=self._address(travels),
            outputs=self._address(outputs),
            output_rows=self._address(rows),
            direct=self._address(direct),
            channels=self._structures(map(self._channel, self._channels)),
            quantities=self._structures(self._quantities()),
            terms=self._integers(self._channels.index(c) for q in quantities for c in q.channels),
            weights=self._address(np.array([w for q in quantities for w in q.weights], dtype=np.float64)),
            limits=self._structures(
                library.Limit(limit.sign, limit.limit, self._outputs.index(self._output(limit.signal)))
                for limit in self.limits
            ),
            series=self._integers(map(self._channels.index, series)),
            step=float(times[1] - times[0]),
            steps=times.size - 1,
            every=every,
            settling=int(np.searchsorted(self.rows, setup.scenario.settling + 1e-9)),
            at_rest=int(vehicle.at_rest),
            output_count=len(self._outputs),
            channel_count=len(self._channels),
            quantity_count=len(quantities),
            limit_count=len(self.limits),
            series_count=len(series),
        )

    # ---- The drive --------------------------------------------------------------------------------------------------

    def _by_drive(self, car: LinearCar, setup: Setup, times: Array, every: int) -> tuple[Array, Array, Array]:
        """Return what the drive does: velocities and travels of the ports (K + 1, C), and outputs at records (R, O)."""
        scenario, feeds = setup.scenario, setup.coupling.feeds[self._name]
        points = times
        if scenario.drive is not None:
            own = scenario.drive.series.time - scenario.drive_start
            points = joined(times, own[(own > 0.0) & (own < times[-1])])
            samples = scenario.drive.sample(points + scenario.drive_start)
        inputs = np.zeros((points.size, len(feeds)))
        for k, feed in enumerate(feeds):
            inputs[:, k] = feed.constant
            if feed.drive is not None:
                inputs[:, k] += feed.drive_conversion.factor * samples[feed.drive] + feed.drive_conversion.offset
        outputs = [*(b.velocity for b in car.bonds), *(b.travel for b in car.bonds), *self._outputs]
        wanted = np.searchsorted(points, times)
        found = car.by_drive(points, inputs, wanted, outputs, self.library.accumulate)
        count = len(car.bonds)
        return found[:, :count], found[:, count : 2 * count], found[::every, 2 * count :]

    # ---- Numbers of channels ----------------------------------------------------------------------------------------

    def _bond(self, bond: Any, feeds: Sequence[Feed]) -> Bond:
        if bond.displacement is None:
            raise NotInBatchError(f"the shock at {bond.name} has no displacement")
        forces = [k for k, feed in enumerate(feeds) if feed.terms and self._shock_of(feed.terms) == bond.name]
        if len(forces) != 1:
            raise NotInBatchError(f"the shock at {bond.name} acts on {len(forces)} inputs of the vehicle")
        return Bond(forces[0], self._output(bond.velocity.source), self._output(bond.displacement.source))

    def _friction(self, bonds: Sequence[Bond]) -> list[tuple[float, ...]]:
        """Return friction and spring of each bond's port, in the order of PortFriction in fmus/machine/car.h."""
        found: list[tuple[float, ...]] = [_FREE] * len(bonds)
        for port in self._vehicle.ports:
            for k, bond in enumerate(bonds):
                if (port.input, port.velocity) == (bond.force, bond.velocity) and port.travel in (None, bond.travel):
                    found[k] = port.friction
                    break
            else:
                if _has_forces(port.friction):
                    raise NotInBatchError("the vehicle has friction or a spring at a port that no shock is coupled to")
        return found

    def _output(self, name: str) -> int:
        component, _, variable = name.partition(".")
        if component != self._name or variable not in self._vehicle.outputs:
            raise NotInBatchError(f"{name} is not an output of the vehicle")
        _check_si(self._system, name)
        return self._vehicle.outputs.index(variable)

    def _channel(self, name: str) -> Any:
        component, _, variable = name.partition(".")
        if component == self._name:
            return library.Channel(-1, self._outputs.index(self._output(name)))
        if component not in self.corners or variable not in _SIGNALS:
            raise NotInBatchError(f"{name} is not recorded in a batch")
        _check_si(self._system, name)
        return library.Channel(self.corners.index(component), _SIGNALS.index(variable))

    def _shock_of(self, terms: Sequence[Term]) -> str:
        source, _, variable = terms[0].source.partition(".")
        if len(terms) > 1 or variable != "force" or source not in self.corners:
            raise NotInBatchError("an input of the vehicle has other sources than a shock and the drive")
        _check_unscaled(terms)
        return source

    def _quantities(self) -> Iterable[Any]:
        first = 0
        for q in self.quantities:
            yield q.structure(first)
            first += len(q.channels)

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


def _has_forces(friction: Sequence[float]) -> bool:
    """Whether a port has friction or a spring."""
    return friction[0] != 0.0 or friction[2] != 0.0 or friction[6] != 0.0


def _regular(setup: Setup) -> tuple[Array, int]:
    """Return equal steps (K + 1,) [s] up to the last record, and their number between records."""
    record = setup.scenario.record_step or setup.step
    every = max(1, round(record / setup.step))
    records = int(setup.times[-1] / record + 1e-9)
    if records < 1:
        raise NotInBatchError("the drive is shorter than the interval between records")
    return np.linspace(0.0, records * record, records * every + 1), every


def _check(setup: Setup) -> None:
    if setup.discrete.is_needed or setup.system.connections:
        raise NotInBatchError("components have connections besides their bonds")
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
