"""Linear vehicle models with named channels; docs/reference/ports.md defines names and signs."""

from eightpost.corners import CORNERS
from eightpost.vehicle.bristle import Bristle
from eightpost.vehicle.conversions import add_port_damping, add_port_stiffness, discretise
from eightpost.vehicle.kernel import LinearStepper
from eightpost.vehicle.quantities import Corners
from eightpost.vehicle.quarter_car import QuarterCar
from eightpost.vehicle.seven_dof import SevenDof
from eightpost.vehicle.statespace import Channel, Mode, StateSpace
from eightpost.vehicle.storage import read_vehicle, shipped, write_vehicle
from eightpost.vehicle.vehicles import Friction, IdentifiedVehicle, StructuralVehicle, Vehicle

__all__ = [
    "CORNERS",
    "Bristle",
    "Channel",
    "Corners",
    "Friction",
    "IdentifiedVehicle",
    "LinearStepper",
    "Mode",
    "QuarterCar",
    "SevenDof",
    "StateSpace",
    "StructuralVehicle",
    "Vehicle",
    "add_port_damping",
    "add_port_stiffness",
    "discretise",
    "read_vehicle",
    "shipped",
    "write_vehicle",
]
