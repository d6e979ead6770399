"""Car on the virtual rig: masses and the elements between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.rig.geometry import Geometry
from eightpost.virtual.kernel import CarNumbers


@dataclass(frozen=True, slots=True, eq=False)
class Car:
    """A simulated car with D coordinates q relative to the static position, C corners and A loads."""

    name: str  #: Name of the car.
    corners: tuple[str, ...]  #: C corner names; one empty name for a quarter car.
    mass: Array  #: Masses (D,) [kg] or inertias [kg.m2] of the coordinates.
    shock: Array  #: Matrix (C, D) from q to the compression of the shocks.
    spring: Array  #: Matrix (C, D) from q to the compression of the springs.
    wheel: Array  #: Matrix (C, D) from q to the heights of the wheels at the tires.
    chassis: Array  #: Matrix (C, D) from q to the heights of the chassis above the wheels.
    loads: tuple[str, ...]  #: A load names, as in a drive file.
    load_units: tuple[str, ...]  #: A load units, N or N.m.
    load: Array  #: Matrix (A, D); the generalised force is load^T f.
    stiffness: Array  #: Stiffness K (D, D) of elements other than springs: anti-roll bars, the twist of the chassis.
    damping: Array  #: Damping C (D, D) of elements other than shocks and tires.
    springs: Springs  #: Suspension springs.
    tires: Tires  #: Tires.
    friction: Friction  #: Friction along the shocks.
    points: Mapping[str, Array]  #: Rows (D,) from q to the heights or angles of other measured points, by name.
    geometry: Geometry | None = None  #: Positions of actuators and measurements, None for a quarter car.

    def named(self, quantity: str) -> tuple[str, ...]:
        """Return `<corner>.<quantity>` for every corner; for a quarter car only the quantity."""
        return tuple(channel(corner, quantity) for corner in self.corners)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of roads and loads, in the order of a drive."""
        return (*self.named("road"), *self.loads)

    @property
    def static_load(self) -> Array:
        """Static loads of the tires (C, 1) [N]; 0 if their forces are changes from static."""
        return np.where(np.isfinite(self.tires.static_load), self.tires.static_load, 0.0)

    def changed(self, friction: float, tire: float) -> Car:
        """Return the car with its friction and the stiffness of its tires multiplied by factors."""
        tires = replace(self.tires, stiffness=self.tires.stiffness * tire)
        return replace(self, friction=self.friction.scaled(friction), tires=tires)

    def without_friction(self) -> Car:
        """Return the same car without friction."""
        return replace(self, friction=self.friction.scaled(0.0))

    def numbers(self) -> CarNumbers:
        """Return the car as arrays for the compiled integration."""
        springs, tires, friction, corners = self.springs, self.tires, self.friction, len(self.corners)
        none, stribeck = np.zeros((corners, 1)), np.full_like(friction.coulomb, friction.stribeck_velocity)
        return CarNumbers(
            mass=self.mass,
            stiffness=self.stiffness,
            damping=self.damping,
            struts=np.vstack([self.shock, self.spring]).astype(np.float64),
            ratios=np.tile([1.0, 0.0, 0.0], (2 * corners, 1)),
            springs=np.hstack([none, springs.rate, springs.progression, springs.stop_gap, springs.stop_rate]),
            wheels=self.wheel.astype(np.float64),
            tires=np.hstack([tires.stiffness, none, none - np.inf, tires.damping, tires.static_load]),
            hysteresis=np.zeros((0, 3)),
            rubs=self.shock.astype(np.float64),
            friction=np.hstack([friction.coulomb, friction.breakaway, friction.stiffness, stribeck]),
            loads=self.load.astype(np.float64),
        )

    def motion(self, records: Array) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations (D, N) of records of the compiled integration."""
        q, v, a = np.split(records.T[: 3 * self.mass.size], 3)
        return q, v, a


# ---- Nonlinear elements of the cars ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Springs:
    """Progressive coil springs and bump stops; s is the compression from the static height, positive in bump.

    F = k s (1 + p s) + k_stop max(s - gap, 0)^2
    """

    rate: Array  #: Spring rates k (C, 1) [N/m].
    progression: Array  #: Progression p (C, 1) [1/m]; the rate at s is k (1 + 2 p s).
    stop_gap: Array  #: Gap to the bump stop (C, 1) [m]; infinite without a stop.
    stop_rate: Array  #: Coefficient k_stop of the bump stop (C, 1) [N/m2].

    @classmethod
    def linear(cls, rate: Array) -> Springs:
        """Return linear springs with a rate (C, 1) [N/m] and without stops."""
        zero = np.zeros_like(rate)
        return cls(rate, zero, zero + np.inf, zero)


@dataclass(frozen=True, slots=True, eq=False)
class Tires:
    """Tires that can push but not pull: the total force is max(0, W + k d + c d'), d = road - wheel."""

    stiffness: Array  #: Stiffness k (C, 1) [N/m].
    damping: Array  #: Damping c (C, 1) [N.s/m].
    static_load: Array  #: Static load W (C, 1) [N]; infinite for tires that never lift off.


@dataclass(frozen=True, slots=True, eq=False)
class Friction:
    """Suspension friction with elastic presliding and stick-slip (LuGre bristle model without micro-damping).

        dz/dt = v - |v| z / z_b(v),  F = sigma z,  z_b = (F_c + (F_s - F_c) exp(-(v / v_s)^2)) / sigma

    Below the breakaway force it sticks and acts as a spring of stiffness sigma; above, it slides with the force F_c.
    """

    coulomb: Array  #: Sliding friction F_c (C, 1) [N].
    breakaway: Array  #: Breakaway force F_s (C, 1) [N], at least F_c.
    stiffness: Array  #: Presliding stiffness sigma (C, 1) [N/m].
    stribeck_velocity: float = 0.01  #: Stribeck velocity v_s [m/s].

    def scaled(self, factor: float) -> Friction:
        """Return a friction with forces multiplied by `factor` and the same presliding distance."""
        return replace(
            self,
            coulomb=self.coulomb * factor,
            breakaway=self.breakaway * factor,
            stiffness=self.stiffness * max(factor, 1e-9),
        )

    @classmethod
    def none(cls, corners: int) -> Friction:
        """Return zero friction for `corners` corners."""
        zero = np.zeros((corners, 1))
        return cls(zero, zero, zero + 1e-9)
