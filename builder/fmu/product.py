"""The content of an FMU, for any target: an interface, and the shock or vehicle that it represents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

from builder.fmu.interface import Interface, shock_interface, spring_ports, vehicle_interface
from builder.fmu.modes import with_modes
from builder.fmu.settings import with_settings
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


def shock_product(shock: Shock, identifier: str, *, temperature_input: bool = False) -> Product:
    """Return the product for a shock.

    Args:
        shock: Shock, with or without settings.
        identifier: C name of the FMU.
        temperature_input: Whether the temperature is an input instead of a parameter.

    Raises:
        FmuError: The temperature is to be an input, but the shock has none.
    """
    interface = shock_interface(shock)
    if shock.settings is not None:
        interface = with_settings(interface, shock.settings, temperature_input=temperature_input)
    elif temperature_input:
        raise FmuError(f"shock {shock.name!r} has no temperature that could be an input (eightpost settings)")
    return Product(identifier, f"{interface.description}: {shock.name}", interface, shock)


def vehicle_product(vehicle: Vehicle, identifier: str) -> Product:
    """Return the product for a vehicle: its model without dampers at the ports, and its static state.

    Raises:
        FmuError: The model is discrete or not stable, has feedthrough to a shock velocity, or has a channel that
            vehicle_ss does not have.
    """
    model = vehicle.coupled()
    if model.dt is not None:
        raise FmuError(f"vehicle {vehicle.name!r} is a discrete model; convert it to continuous time first")
    if isinstance(vehicle, IdentifiedVehicle) and (growing := vehicle.instability()) is not None:
        raise FmuError(
            f"vehicle {vehicle.name!r} is not stable: {growing}, so that runs with it diverge; identify it with more "
            "or longer tests, or without the channels that fit worst (--output-channels)"
        )
    _refuse_direct_velocity(model)
    interface = with_modes(vehicle_interface(model), model)
    starts = {v.offset: vehicle.static.get(v.name, 0.0) for v in interface.variables if v.offset}
    if isinstance(vehicle, IdentifiedVehicle):
        starts |= _friction_starts(vehicle.friction, interface)
    variables = tuple(replace(v, start=starts[v.name]) if v.name in starts else v for v in interface.variables)
    interface = replace(interface, variables=variables)
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


def _friction_starts(friction: Mapping[str, Friction], interface: Interface) -> dict[str, float]:
    """Return the start values of friction and springs at the ports; `friction` holds them by port.

    Raises:
        FmuError: A port has a spring, but its displacement has feedthrough.
    """
    starts: dict[str, float] = {}
    for port, law in friction.items():
        prefix = f"{port}." if port else ""
        if law.spring and prefix not in spring_ports(interface):
            raise FmuError(
                f"the port {port!r} has a spring, but {prefix}displacement has feedthrough, which makes an algebraic "
                "loop with the spring; identify it without feedthrough, or remove the spring"
            )
        own = {f"bristle_{name}": value for name, value in asdict(law.bristle).items()}
        own |= {"friction_force": law.force, "friction_velocity": law.velocity}
        own |= {"port_spring": law.spring} if prefix in spring_ports(interface) else {}
        starts |= {f"{prefix}{name}": value for name, value in own.items()}
    return starts
