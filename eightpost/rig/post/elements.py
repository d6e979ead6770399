"""The nonlinear elements of the virtual rig's cars: springs with stops, tires that lift, friction that sticks.

Every function works on (C, B) arrays: corner by run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Slowest sliding that counts as motion [m/s]; below it the friction's state does not change.
_STILL = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Springs:
    """Progressive coil springs and bump stops, over compression s from the static height, positive in bump.

        F = k s (1 + p s) + k_stop max(s - gap, 0)^2

    Attributes:
        rate: k (C, 1) [N/m].
        progression: p (C, 1) [1/m]; the rate at s is k (1 + 2 p s).
        stop_gap: (C, 1) [m]; infinite for no stop.
        stop_rate: k_stop (C, 1) [N/m2].
    """

    rate: Array
    progression: Array
    stop_gap: Array
    stop_rate: Array

    def force(self, compression: Array) -> Array:
        """Return F (C, B) [N] over the static force, at a compression (C, B) [m]."""
        spring = self.rate * compression * (1.0 + self.progression * compression)
        into = np.maximum(compression - self.stop_gap, 0.0)
        return np.asarray(spring + self.stop_rate * into * into)

    def energy(self, compression: Array) -> Array:
        """Return the stored energy (C, B) [J] over that at the static height, without the static force's work."""
        into = np.maximum(compression - self.stop_gap, 0.0)
        spring = self.rate * compression**2 * (0.5 + self.progression * compression / 3.0)
        return np.asarray(spring + self.stop_rate * into**3 / 3.0)

    @classmethod
    def linear(cls, rate: Array) -> Springs:
        """Return plain springs of a rate (C, 1) [N/m]."""
        zero = np.zeros_like(rate)
        return cls(rate, zero, zero + np.inf, zero)


@dataclass(frozen=True, slots=True, eq=False)
class Tires:
    """Tires that push and never pull: the whole force is max(0, W + k d + c d'), d = road - wheel.

    Attributes:
        stiffness: k (C, 1) [N/m].
        damping: c (C, 1) [N.s/m].
        static_load: W (C, 1) [N]; infinite for tires that never lift (then forces are changes from static).
    """

    stiffness: Array
    damping: Array
    static_load: Array

    def force(self, deflection: Array, speed: Array) -> Array:
        """Return the change of the tire force from static (C, B) [N]; at least -W."""
        return np.asarray(np.maximum(self.stiffness * deflection + self.damping * speed, -self.static_load))


@dataclass(frozen=True, slots=True, eq=False)
class Friction:
    """Suspension friction with elastic presliding and stick-slip (LuGre's bristle without its micro-damping).

        dz/dt = v - |v| z / z_b(v),  F = sigma z,  z_b = (F_c + (F_s - F_c) exp(-(v / v_s)^2)) / sigma

    Below the breakaway force it is a spring of stiffness sigma and holds; beyond, it slides at F_c.

    Attributes:
        coulomb: F_c (C, 1) [N].
        breakaway: F_s (C, 1) [N], at least F_c.
        stiffness: sigma (C, 1) [N/m].
        stribeck_velocity: v_s [m/s].
    """

    coulomb: Array
    breakaway: Array
    stiffness: Array
    stribeck_velocity: float = 0.01

    def bend(self, before: Array, velocity: Array, step: float) -> Array:
        """Return z (C, B) [m] after `step` [s] at a velocity (C, B) [m/s] that is held: exactly."""
        speed = np.abs(velocity)
        ratio = velocity / self.stribeck_velocity
        level = self.coulomb + (self.breakaway - self.coulomb) * np.exp(-ratio * ratio)
        reach = np.maximum(level, 1e-9) / self.stiffness
        steady = np.sign(velocity) * reach
        after = steady + (before - steady) * np.exp(-speed * step / reach)
        return np.asarray(np.where(speed > _STILL, after, before))

    def force(self, bend: Array) -> Array:
        """Return F (C, B) [N], positive in compression."""
        return np.asarray(self.stiffness * bend)

    def scaled(self, factor: float) -> Friction:
        """Return a friction whose forces are `factor` times as large, of the same presliding distance."""
        return replace(
            self,
            coulomb=self.coulomb * factor,
            breakaway=self.breakaway * factor,
            stiffness=self.stiffness * max(factor, 1e-9),
        )

    @classmethod
    def none(cls, corners: int) -> Friction:
        """Return no friction at `corners` corners."""
        zero = np.zeros((corners, 1))
        return cls(zero, zero, zero + 1e-9)
