"""The content of an FMU, for any target: an interface, and the shock or vehicle that it represents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from builder.fmu.interface import Interface, shock_interface, vehicle_interface
from builder.fmu.modes import with_modes
from eightpost.errors import FmuError
from eightpost.shock import Shock
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, Vehicle


@dataclass(frozen=True)
class Product:
    """One FMU to build: its C name, a one-line description, its variables, and the shock or vehicle it represents."""

    identifier: str
    text: str
    interface: Interface
    source: Shock | Vehicle

    @property
    def sources(self) -> str:
        """Name of the folder under fmus/ that contains its code."""
        return self.interface.kind


def shock_product(shock: Shock, identifier: str) -> Product:
    """Return the product for a shock."""
    interface = shock_interface(shock)
    return Product(identifier, f"{interface.description}: {shock.name}", interface, shock)


def vehicle_product(vehicle: Vehicle, identifier: str) -> Product:
    """Return the product for a vehicle: its model without dampers at the ports, and its static state.

    Raises:
        FmuError: The model is discrete, has feedthrough to a shock velocity, or has a channel that vehicle_ss does
            not have.
    """
    model = vehicle.coupled()
    if model.dt is not None:
        raise FmuError(f"vehicle {vehicle.name!r} is a discrete model; convert it to continuous time first")
    _refuse_direct_velocity(model)
    interface = _with_static(with_modes(vehicle_interface(model), model), vehicle.static)
    if isinstance(vehicle, IdentifiedVehicle):
        interface = _with_friction(interface, vehicle.friction)
    return Product(identifier, f"{interface.description}: {vehicle.name}", interface, vehicle)


def _refuse_direct_velocity(model: StateSpace) -> None:
    """Raise an error if a shock velocity has feedthrough: it would make an algebraic loop with the shock."""
    for channel, terms in zip(model.outputs, model.D != 0.0, strict=True):
        if channel.name.rpartition(".")[2] == "velocity" and terms.any():
            inputs = ", ".join(c.name for c, term in zip(model.inputs, terms, strict=True) if term)
            raise FmuError(
                f"vehicle {model.name!r}: {channel.name} has feedthrough from {inputs} (D is not zero there), which "
                "makes an algebraic loop with the shock; identify it without feedthrough to the shock velocities"
            )


def _with_static(interface: Interface, static: Mapping[str, float]) -> Interface:
    """Return the interface with start values for the static offsets; `static` holds them by output."""
    starts = {v.offset: static.get(v.name, 0.0) for v in interface.variables if v.offset}
    variables = tuple(replace(v, start=starts[v.name]) if v.name in starts else v for v in interface.variables)
    return replace(interface, variables=variables)


def _with_friction(interface: Interface, friction: Mapping[str, Friction]) -> Interface:
    """Return the interface with start values for the friction; `friction` holds it by port."""
    starts: dict[str, float] = {}
    for port, law in friction.items():
        prefix = f"{port}." if port else ""
        starts |= {f"{prefix}friction_force": law.force, f"{prefix}friction_velocity": law.velocity}
    variables = tuple(replace(v, start=starts[v.name]) if v.name in starts else v for v in interface.variables)
    return replace(interface, variables=variables)
