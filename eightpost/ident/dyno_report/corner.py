"""Damping ratio of a shock on a corner of a car."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from pathlib import Path

from eightpost.corners import CORNERS
from eightpost.errors import InputError, ParameterError
from eightpost.ident.dyno_report.found import Found, Unknown
from eightpost.vehicle import QuarterCar, StructuralVehicle, read_vehicle


@dataclass(frozen=True, slots=True)
class CarCorner:
    """A corner of a car.

    Attributes:
        name: Display name.
        mass: Sprung mass on the corner [kg].
        wheel_rate: Rate of the suspension at the wheel [N/m].
        motion_ratio: Damper travel per wheel travel [1].

    Raises:
        ParameterError: A value is not positive.
    """

    name: str
    mass: float
    wheel_rate: float
    motion_ratio: float = 1.0

    def __post_init__(self) -> None:
        for what, value, option in (
            ("sprung mass", self.mass, "--corner-mass"),
            ("wheel rate", self.wheel_rate, "--wheel-rate"),
            ("motion ratio", self.motion_ratio, "--motion-ratio"),
        ):
            if not value > 0.0:
                raise ParameterError(f"{self.name}: the {what} must be above 0, not {value:g}; correct {option}")

    def damping_ratio(self, rate: Found) -> Found:
        """Return c r^2 / (2 sqrt(k m)) [1] of a damping rate c at the damper [N.s/m].

        The tire is rigid in this equation, and the damper moves r times as far as the wheel.

        Args:
            rate: Damping rate at the damper [N.s/m].
        """
        if isinstance(rate, Unknown):
            return rate
        return rate * self.motion_ratio**2 / (2.0 * sqrt(self.wheel_rate * self.mass))


def corners_of_car(path: Path, motion_ratio: float = 1.0) -> tuple[CarCorner, ...]:
    """Return the corners of a car file: one of a quarter car, four of a seven-DOF car with the static weight of each.

    Args:
        path: Vehicle file (.toml) with masses and rates.
        motion_ratio: Damper travel per wheel travel [1].

    Raises:
        InputError: The file is an identified model, which has no separate masses and rates.
    """
    vehicle = read_vehicle(path)
    if not isinstance(vehicle, StructuralVehicle):
        raise InputError(
            f"{path} is an identified model without separate masses and wheel rates; give a .toml file, or "
            "--corner-mass and --wheel-rate"
        )
    found = vehicle.parameters
    if isinstance(found, QuarterCar):
        return (CarCorner(vehicle.name, found.sprung_mass, found.suspension_stiffness, motion_ratio),)
    front = 0.5 * found.sprung_mass * found.cg_to_rear_axle / found.wheelbase
    rear = 0.5 * found.sprung_mass * found.cg_to_front_axle / found.wheelbase
    masses = (front, front, rear, rear)
    return tuple(
        CarCorner(corner, mass, rate, motion_ratio)
        for corner, mass, rate in zip(CORNERS, masses, found.spring_rate, strict=True)
    )
