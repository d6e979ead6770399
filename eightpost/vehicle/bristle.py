"""Friction that sticks: a bristle that bends with the port and slides at a given deflection.

    z' = v - |v| z / z_b(v),   z_b(v) = z_s (1 + (rho - 1) exp(-(v / v_s)^2)),   F = F_s z / z_s

with the port velocity v, the deflection z, the reach z_s and the sliding force F_s. For a port that moves much less
than the reach the bristle is a spring of stiffness F_s / z_s, so that the port sticks. At a port that slides the force
is F_s, and up to rho F_s at speeds below the Stribeck velocity v_s. The force is positive in compression. The functions
take numbers or arrays.

The python FMU of a vehicle contains this file, so it imports numpy only. `eightpost.vehicle.compiled` compiles it.

Source: C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, "A new model for control of systems with friction",
IEEE Trans. Autom. Control 40 (1995) 419-425, doi 10.1109/9.376053, without micro-damping and viscous friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


def sliding_deflection(v: Any, reach: Any, static_ratio: Any, stribeck_velocity: Any) -> Any:
    """Return the deflection z_b [m] at which a bristle slides with the velocity `v` [m/s]; see `Bristle`."""
    ratio = v / stribeck_velocity
    return reach * (1.0 + (static_ratio - 1.0) * np.exp(-ratio * ratio))


def deflection_after(z: Any, v: Any, h: Any, reach: Any, static_ratio: Any, stribeck_velocity: Any) -> Any:
    """Return the deflection [m] after `h` seconds at the constant velocity `v`, from the deflection `z` [m].

        z+ = s z_b + (z - s z_b) exp(-|v| h / z_b),   s = sign v

    It is exact for a constant velocity, and equal to `z` for none. For a velocity that changes, `v` is its mean.
    """
    limit = sliding_deflection(v, reach, static_ratio, stribeck_velocity)
    return z - (np.copysign(limit, v) - z) * np.expm1(-np.abs(v) * h / limit)


@dataclass(frozen=True, slots=True)
class Bristle:
    """Parameters of a bristle."""

    force: float = 0.0  #: Sliding force F_s [N], not below zero; zero is no friction.
    reach: float = 1e-4  #: Deflection z_s at which the bristle slides with the sliding force [m], above zero.
    static_ratio: float = 1.0  #: Static over sliding force rho [1], at least 1.
    #: Velocity v_s at which the static force has fallen to the sliding force [m/s], above zero: the excess at v_s is 1
    #: / e of that at rest.
    stribeck_velocity: float = 0.01

    @property
    def stiffness(self) -> float:
        """Stiffness of a port that sticks, F_s / z_s [N/m]."""
        return self.force / self.reach

    def deflection_after(self, z: Any, v: Any, h: Any) -> Any:
        """Return the deflection [m] after `h` seconds at the mean velocity `v` [m/s], from the deflection `z` [m]."""
        return deflection_after(z, v, h, self.reach, self.static_ratio, self.stribeck_velocity)

    def force_at(self, z: Any) -> Any:
        """Return the force [N] at a deflection `z` [m]."""
        return self.force / self.reach * z
