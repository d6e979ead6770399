"""Linear vehicle models with named channels; docs/reference/ports.md defines names and signs."""

from eightpost.corners import CORNERS
from eightpost.vehicle.friction import Bristle
from eightpost.vehicle.kernel import LinearStepper
from eightpost.vehicle.statespace import Channel, Mode, StateSpace, add_port_damping, add_port_stiffness, discretise
from eightpost.vehicle.structural import Corners, QuarterCar, SevenDof
from eightpost.vehicle.vehicles import (
    Friction,
    IdentifiedVehicle,
    StructuralVehicle,
    Vehicle,
    read_vehicle,
    shipped,
    write_vehicle,
)

__all__ = [
    "CORNERS", "Bristle", "Channel", "Corners", "Friction", "IdentifiedVehicle", "LinearStepper", "Mode",
    "QuarterCar", "SevenDof", "StateSpace", "StructuralVehicle", "Vehicle", "add_port_damping",
    "add_port_stiffness", "discretise", "read_vehicle", "shipped", "write_vehicle",
]  # fmt: skip
