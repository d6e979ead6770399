"""A vehicle FMU and the shocks of a system at its ports, by the numbers of its inputs and outputs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cosim.components.component import Conversion, to_si
from cosim.study.machine.car import FmuVehicle
from cosim.systems.coupling import Feed, Scenario, Term
from cosim.systems.system import Bond, System
from eightpost.array_types import Array
from eightpost.machine import NotInBatchError, Port


class WiredCar:
    """A vehicle whose forces come from shocks at its ports, and whose other inputs come from the drive.

    Args:
        system: System of the vehicle and its shocks.
        feeds: Sources of the inputs of every component.
        name: Name of the vehicle's component.
        vehicle: Vehicle.

    Attributes:
        vehicle: Vehicle.
        shocks: Components of the shocks, in the order of the bonds.
        ports: Port of each shock, with the friction and springs that the vehicle has there.

    Raises:
        NotInBatchError: The system has other connections than bonds between the vehicle and shocks.
    """

    def __init__(self, system: System, feeds: Mapping[str, Sequence[Feed]], name: str, vehicle: FmuVehicle) -> None:
        self.vehicle, self.name, self._system = vehicle, name, system
        self.shocks = tuple(shock_of(bond) for bond in system.bonds)
        self._feeds = feeds[name]
        self._check(feeds)
        self.ports = self._with_friction([self._port(bond) for bond in system.bonds])

    def output(self, name: str) -> int:
        """Return the number of an output `component.variable` of the vehicle."""
        component, _, variable = name.partition(".")
        if component != self.name or variable not in self.vehicle.outputs:
            raise NotInBatchError(f"{name} is not an output of the vehicle")
        self.check_si(name)
        return self.vehicle.outputs.index(variable)

    def check_si(self, name: str) -> None:
        """Raise an error if an output `component.variable` is not in an SI unit."""
        if to_si(self._system.output(name))[0] != Conversion():
            raise NotInBatchError(f"{name} is not in an SI unit")

    def inputs(self, scenario: Scenario, times: Array) -> Array:
        """Return what constants and drive give to the inputs of the vehicle (K, m) at times (K,) [s]."""
        values = np.zeros((times.size, len(self._feeds)))
        if scenario.drive is not None:
            samples = scenario.drive.sample(times + scenario.drive_start)
        for k, feed in enumerate(self._feeds):
            values[:, k] = feed.constant
            if feed.drive is not None:
                values[:, k] += feed.drive_conversion.factor * samples[feed.drive] + feed.drive_conversion.offset
        return values

    def _port(self, bond: Bond) -> Port:
        if bond.displacement is None:
            raise NotInBatchError(f"the shock at {bond.name} has no displacement")
        forces = [k for k, feed in enumerate(self._feeds) if feed.terms and self._source(feed.terms) == shock_of(bond)]
        if len(forces) != 1:
            raise NotInBatchError(f"the shock at {bond.name} acts on {len(forces)} inputs of the vehicle")
        return Port(forces[0], self.output(bond.velocity.source), self.output(bond.displacement.source))

    def _with_friction(self, shocks: Sequence[Port]) -> list[Port]:
        found = list(shocks)
        for port in self.vehicle.ports:
            for k, shock in enumerate(shocks):
                if (port.force, port.velocity) == (shock.force, shock.velocity) and port.travel in (None, shock.travel):
                    found[k] = replace(shock, friction=port.friction)
                    break
            else:
                if port.has_forces:
                    raise NotInBatchError("the vehicle has friction or a spring at a port that no shock is coupled to")
        return found

    def _source(self, terms: Sequence[Term]) -> str:
        source, _, variable = terms[0].source.partition(".")
        if len(terms) > 1 or variable != "force" or source not in self.shocks:
            raise NotInBatchError("an input of the vehicle has other sources than a shock and the drive")
        _check_unscaled(terms)
        return source

    def _check(self, feeds: Mapping[str, Sequence[Feed]]) -> None:
        if self._system.connections:
            raise NotInBatchError("components have connections besides their bonds")
        for bond, shock in zip(self._system.bonds, self.shocks, strict=True):
            for feed in feeds[shock]:
                if len(feed.terms) != 1 or feed.drive is not None or feed.constant != 0.0:
                    raise NotInBatchError(f"an input of the shock at {bond.name} has other sources than the vehicle")
                _check_unscaled(feed.terms)


def shock_of(bond: Bond) -> str:
    """Return the component of the shock of a bond."""
    return bond.force.source.partition(".")[0]


def _check_unscaled(terms: Iterable[Term]) -> None:
    if any(term.gain != 1.0 or term.conversion != Conversion() for term in terms):
        raise NotInBatchError("a connection has a gain or converts a unit")
