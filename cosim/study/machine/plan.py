"""A run of all setups of a study on one drive, on the machine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from cosim.components.component import Conversion, to_si
from cosim.session.setup import Setup, joined
from cosim.study.machine.car import FmuVehicle
from cosim.systems.coupling import Feed, Term
from cosim.systems.system import Bond, System
from eightpost.array_types import Array
from eightpost.machine import SIGNALS, Drive, Limit, LinearCar, NotInBatchError, Port, Quantity, Run


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
        run: Run of the machine.
        rows: Times of the recorded rows (R,) [s].

    Raises:
        NotInBatchError: The run is not one of a vehicle with shocks at its ports.
        FmuError: There is no compiler, or it fails.
    """

    def __init__(
        self,
        setup: Setup,
        name: str,
        vehicle: FmuVehicle,
        damping: Array,
        quantities: Sequence[Quantity],
        series: Sequence[str],
        *,
        width: str | None = None,
    ) -> None:
        self.corners = tuple(bond.name for bond in setup.system.bonds)
        self._vehicle, self._name, self._system = vehicle, name, setup.system
        _check(setup)
        feeds = setup.coupling.feeds[name]
        car = LinearCar.of(vehicle, self._ports([self._port(bond, feeds) for bond in setup.system.bonds]), damping)
        drive = _drive(setup, feeds)
        self.limits = tuple(limit for limit in setup.limits.watched if limit.signal.startswith(f"{name}."))
        names = {*series, *(channel for q in quantities for channel in q.channels)}
        self.run = Run(
            car,
            drive,
            {channel: self._channel(channel) for channel in names},
            quantities=quantities,
            limits=[Limit(limit.sign, limit.limit, self._output(limit.signal)) for limit in self.limits],
            series=series,
            settling=int(np.searchsorted(drive.times[:: drive.every], setup.scenario.settling + 1e-9)),
            width=width,
        )
        self.rows, self.series = self.run.rows, self.run.series

    # ---- Numbers of channels ----------------------------------------------------------------------------------------

    def _port(self, bond: Bond, feeds: Sequence[Feed]) -> Port:
        if bond.displacement is None:
            raise NotInBatchError(f"the shock at {bond.name} has no displacement")
        forces = [k for k, feed in enumerate(feeds) if feed.terms and self._shock_of(feed.terms) == bond.name]
        if len(forces) != 1:
            raise NotInBatchError(f"the shock at {bond.name} acts on {len(forces)} inputs of the vehicle")
        return Port(forces[0], self._output(bond.velocity.source), self._output(bond.displacement.source))

    def _ports(self, shocks: Sequence[Port]) -> list[Port]:
        """Return the shocks' ports with the friction and springs that the vehicle has there."""
        found = list(shocks)
        for port in self._vehicle.ports:
            for k, shock in enumerate(shocks):
                if (port.force, port.velocity) == (shock.force, shock.velocity) and port.travel in (None, shock.travel):
                    found[k] = replace(shock, friction=port.friction)
                    break
            else:
                if port.has_forces:
                    raise NotInBatchError("the vehicle has friction or a spring at a port that no shock is coupled to")
        return found

    def _output(self, name: str) -> int:
        component, _, variable = name.partition(".")
        if component != self._name or variable not in self._vehicle.outputs:
            raise NotInBatchError(f"{name} is not an output of the vehicle")
        _check_si(self._system, name)
        return self._vehicle.outputs.index(variable)

    def _channel(self, name: str) -> tuple[int, int]:
        component, _, variable = name.partition(".")
        if component == self._name:
            return -1, self._output(name)
        if component not in self.corners or variable not in SIGNALS:
            raise NotInBatchError(f"{name} is not recorded in a batch")
        _check_si(self._system, name)
        return self.corners.index(component), SIGNALS.index(variable)

    def _shock_of(self, terms: Sequence[Term]) -> str:
        source, _, variable = terms[0].source.partition(".")
        if len(terms) > 1 or variable != "force" or source not in self.corners:
            raise NotInBatchError("an input of the vehicle has other sources than a shock and the drive")
        _check_unscaled(terms)
        return source


def _drive(setup: Setup, feeds: Sequence[Feed]) -> Drive:
    scenario, (times, every) = setup.scenario, _regular(setup)
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
    return Drive(times, every, points, inputs)


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
