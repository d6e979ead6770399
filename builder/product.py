"""What an FMU is made of, whichever target it is built for: an interface, and the shock or the vehicle behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from builder.interface import Interface, shock_interface, vehicle_interface
from eightpost.errors import FmuError
from eightpost.shock import Shock
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, Vehicle


@dataclass(frozen=True)
class Product:
    """One FMU to be: its C name, one line of text, its variables, and what it was made from."""

    identifier: str
    text: str
    interface: Interface
    source: Shock | Vehicle

    @property
    def sources(self) -> str:
        """The folder under fmus/ that its code is in."""
        return self.interface.kind


def shock_product(shock: Shock, identifier: str) -> Product:
    """Return the FMU to be of a shock."""
    interface = shock_interface(shock)
    return Product(identifier, f"{interface.description}: {shock.name}", interface, shock)


def vehicle_product(vehicle: Vehicle, identifier: str) -> Product:
    """Return the FMU to be of a vehicle: of its model without dampers at the ports, and its static state.

    Raises:
        FmuError: The model is discrete, has a direct term in a shock velocity, or a channel that vehicle_ss does
            not know.
    """
    model = vehicle.coupled()
    if model.dt is not None:
        raise FmuError(f"vehicle {vehicle.name!r} is a discrete model; convert it to continuous time first")
    _refuse_direct_velocity(model)
    interface = _with_static(vehicle_interface(model), vehicle.static)
    if isinstance(vehicle, IdentifiedVehicle):
        interface = _with_friction(interface, vehicle.friction)
    return Product(identifier, f"{interface.description}: {vehicle.name}", interface, vehicle)


def _refuse_direct_velocity(model: StateSpace) -> None:
    """A shock velocity with a direct term makes an algebraic loop with the shock (docs/ports.md)."""
    for channel, terms in zip(model.outputs, model.D != 0.0, strict=True):
        if channel.name.rpartition(".")[2] == "velocity" and terms.any():
            inputs = ", ".join(c.name for c, term in zip(model.inputs, terms, strict=True) if term)
            raise FmuError(
                f"vehicle {model.name!r}: {channel.name} follows {inputs} without delay (D is not zero there), which "
                "makes an algebraic loop with the shock; identify it without direct terms in the shock velocities"
            )


def _with_static(interface: Interface, static: Mapping[str, float]) -> Interface:
    """Give the static offsets their start values; `static` has them by output."""
    starts = {v.offset: static.get(v.name, 0.0) for v in interface.variables if v.offset}
    variables = tuple(replace(v, start=starts[v.name]) if v.name in starts else v for v in interface.variables)
    return replace(interface, variables=variables)


def _with_friction(interface: Interface, friction: Mapping[str, Friction]) -> Interface:
    """Give the friction its start values; `friction` has it by port."""
    starts: dict[str, float] = {}
    for port, law in friction.items():
        prefix = f"{port}." if port else ""
        starts |= {f"{prefix}friction_force": law.force, f"{prefix}friction_velocity": law.velocity}
    variables = tuple(replace(v, start=starts[v.name]) if v.name in starts else v for v in interface.variables)
    return replace(interface, variables=variables)
