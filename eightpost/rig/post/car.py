"""A car on the virtual rig: masses, where its elements sit, and its equation of motion.

    M q'' = sum_shock -(F_shock + F_friction) d(s)/dq + sum_spring -F_spring d(s)/dq
            + sum_tire F_tire d(w)/dq + sum_load f d(p)/dq - K q - C q'

by virtual work, with s the compression of shocks and springs, w the wheels' heights and p where loads act. Nothing
here is shared with the models that are identified (`eightpost.vehicle`).
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
    """Where the rig touches and measures a four-wheeled car, from its centre of gravity.

    Attributes:
        front_axle: a, forward to the front axle [m].
        rear_axle: b, back to the rear axle [m].
        front_aero: a', forward to the front aeroloaders [m].
        rear_aero: b', back to the rear aeroloaders [m].
        front_aero_track: t_f', between the front aeroloaders [m].
        rear_aero_track: t_r' [m].
        front_overhang: Front axle to the nose, where the front ride height is [m].
        rear_overhang: Rear axle to the spoiler [m].
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
    """A truth: D coordinates q from the static position, C corners, A loads.

    Attributes:
        name: Of the truth.
        corners: C corner names; one empty name for a quarter car.
        mass: (D,) [kg] or [kg.m2].
        shock: (C, D), s' of the shocks.
        spring: (C, D), s of the springs.
        wheel: (C, D), heights of the tires' contact.
        chassis: (C, D), heights of the chassis above the wheels.
        loads: A load names, as in a drivefile.
        load_units: N or N.m each.
        load: (A, D), generalised force = load^T f.
        stiffness: K (D, D), what is not a spring: anti-roll bars, the chassis' twist.
        damping: C (D, D).
        springs: The suspension's.
        tires: The tires.
        friction: Along the shocks.
        points: (D,) rows by name of further points that are measured.
        geometry: Of the rig, None for a quarter car.
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
        """Return `<corner>.<quantity>` of every corner; the bare quantity for a quarter car."""
        return tuple(f"{corner}.{quantity}" if corner else quantity for corner in self.corners)

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of roads and loads, in the order of a drive."""
        return (*self.named("road"), *self.loads)

    def without_friction(self) -> Car:
        """Return the same car without friction."""
        return replace(self, friction=self.friction.scaled(0.0))
