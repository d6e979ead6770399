"""Nonlinear elements of the cars: progressive springs with bump stops, tires that lift off, stick-slip friction.

All functions work on arrays (C, B) of corners by runs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Minimum sliding velocity [m/s]; below it the state of the friction does not change.
_STILL = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Springs:
    """Progressive coil springs and bump stops; s is the compression from the static height, positive in bump.

        F = k s (1 + p s) + k_stop max(s - gap, 0)^2

    Attributes:
        rate: Spring rates k (C, 1) [N/m].
        progression: Progression p (C, 1) [1/m]; the rate at s is k (1 + 2 p s).
        stop_gap: Gap to the bump stop (C, 1) [m]; infinite without a stop.
        stop_rate: Coefficient k_stop of the bump stop (C, 1) [N/m2].
    """

    rate: Array
    progression: Array
    stop_gap: Array
    stop_rate: Array

    def force(self, compression: Array) -> Array:
        """Return the change F of the force from static (C, B) [N] at a compression (C, B) [m]."""
        spring = self.rate * compression * (1.0 + self.progression * compression)
        into = np.maximum(compression - self.stop_gap, 0.0)
        return np.asarray(spring + self.stop_rate * into * into)

    def energy(self, compression: Array) -> Array:
        """Return the change of stored energy from static (C, B) [J], without the work of the static force."""
        into = np.maximum(compression - self.stop_gap, 0.0)
        spring = self.rate * compression**2 * (0.5 + self.progression * compression / 3.0)
        return np.asarray(spring + self.stop_rate * into**3 / 3.0)

    @classmethod
    def linear(cls, rate: Array) -> Springs:
        """Return linear springs with a rate (C, 1) [N/m] and without stops."""
        zero = np.zeros_like(rate)
        return cls(rate, zero, zero + np.inf, zero)


@dataclass(frozen=True, slots=True, eq=False)
class Tires:
    """Tires that can push but not pull: the total force is max(0, W + k d + c d'), d = road - wheel.

    Attributes:
        stiffness: Stiffness k (C, 1) [N/m].
        damping: Damping c (C, 1) [N.s/m].
        static_load: Static load W (C, 1) [N]; infinite for tires that never lift off.
    """

    stiffness: Array
    damping: Array
    static_load: Array

    def force(self, deflection: Array, speed: Array) -> Array:
        """Return the change of the tire force from static (C, B) [N], with the minimum -W."""
        return np.asarray(np.maximum(self.stiffness * deflection + self.damping * speed, -self.static_load))


@dataclass(frozen=True, slots=True, eq=False)
class Friction:
    """Suspension friction with elastic presliding and stick-slip (LuGre bristle model without micro-damping).

        dz/dt = v - |v| z / z_b(v),  F = sigma z,  z_b = (F_c + (F_s - F_c) exp(-(v / v_s)^2)) / sigma

    Below the breakaway force it sticks and acts as a spring of stiffness sigma; above, it slides with the force F_c.

    Attributes:
        coulomb: Sliding friction F_c (C, 1) [N].
        breakaway: Breakaway force F_s (C, 1) [N], at least F_c.
        stiffness: Presliding stiffness sigma (C, 1) [N/m].
        stribeck_velocity: Stribeck velocity v_s [m/s].
    """

    coulomb: Array
    breakaway: Array
    stiffness: Array
    stribeck_velocity: float = 0.01

    def bend(self, before: Array, velocity: Array, step: float) -> Array:
        """Return the exact bristle deflection z (C, B) [m] after `step` [s] at a constant velocity (C, B) [m/s]."""
        speed = np.abs(velocity)
        ratio = velocity / self.stribeck_velocity
        level = self.coulomb + (self.breakaway - self.coulomb) * np.exp(-ratio * ratio)
        reach = np.maximum(level, 1e-9) / self.stiffness
        steady = np.sign(velocity) * reach
        after = steady + (before - steady) * np.exp(-speed * step / reach)
        return np.asarray(np.where(speed > _STILL, after, before))

    def force(self, bend: Array) -> Array:
        """Return the friction force F (C, B) [N], positive in compression."""
        return np.asarray(self.stiffness * bend)

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
