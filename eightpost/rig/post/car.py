"""Car on the virtual rig: masses, positions of its elements, and equation of motion.

    M q'' = sum_shock -(F_shock + F_friction) d(s)/dq + sum_spring -F_spring d(s)/dq
            + sum_tire F_tire d(w)/dq + sum_load f d(p)/dq - K q - C q'

The equation follows from virtual work, with s the compression of shocks and springs, w the heights of the wheels and p
the displacements at which loads act. No code is shared with the models that are identified (`eightpost.vehicle`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.rig.post.elements import Friction, Springs, Tires

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Geometry:
    """Positions of actuators and measurements on a four-wheeled car, relative to its centre of gravity.

    Attributes:
        front_axle: Distance a forward to the front axle [m].
        rear_axle: Distance b back to the rear axle [m].
        front_aero: Distance a' forward to the front aeroloaders [m].
        rear_aero: Distance b' back to the rear aeroloaders [m].
        front_aero_track: Distance t_f' between the front aeroloaders [m].
        rear_aero_track: Distance t_r' between the rear aeroloaders [m].
        front_overhang: Distance from the front axle to the nose, where the front ride height is measured [m].
        rear_overhang: Distance from the rear axle to the spoiler, where the rear ride height is measured [m].
    """

    front_axle: float
    rear_axle: float
    front_aero: float
    rear_aero: float
    front_aero_track: float
    rear_aero_track: float
    front_overhang: float
    rear_overhang: float


@dataclass(frozen=True, slots=True, eq=False)
class Car:
    """A simulated car with D coordinates q relative to the static position, C corners and A loads.

    Attributes:
        name: Name of the car.
        corners: C corner names; one empty name for a quarter car.
        mass: Masses (D,) [kg] or inertias [kg.m2] of the coordinates.
        shock: Matrix (C, D) from q to the compression of the shocks.
        spring: Matrix (C, D) from q to the compression of the springs.
        wheel: Matrix (C, D) from q to the heights of the wheels at the tires.
        chassis: Matrix (C, D) from q to the heights of the chassis above the wheels.
        loads: A load names, as in a drive file.
        load_units: A load units, N or N.m.
        load: Matrix (A, D); the generalised force is load^T f.
        stiffness: Stiffness K (D, D) of elements other than springs: anti-roll bars, the twist of the chassis.
        damping: Damping C (D, D) of elements other than shocks and tires.
        springs: Suspension springs.
        tires: Tires.
        friction: Friction along the shocks.
        points: Rows (D,) from q to the heights or angles of other measured points, by name.
        geometry: Positions of actuators and measurements, None for a quarter car.
    """

    name: str
    corners: tuple[str, ...]
    mass: Array
    shock: Array
    spring: Array
    wheel: Array
    chassis: Array
    loads: tuple[str, ...]
    load_units: tuple[str, ...]
    load: Array
    stiffness: Array
    damping: Array
    springs: Springs
    tires: Tires
    friction: Friction
    points: Mapping[str, Array]
    geometry: Geometry | None = None

    def named(self, quantity: str) -> tuple[str, ...]:
        """Return `<corner>.<quantity>` for every corner; for a quarter car only the quantity."""
        return tuple(f"{corner}.{quantity}" if corner else quantity for corner in self.corners)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of roads and loads, in the order of a drive."""
        return (*self.named("road"), *self.loads)

    def without_friction(self) -> Car:
        """Return the same car without friction."""
        return replace(self, friction=self.friction.scaled(0.0))
