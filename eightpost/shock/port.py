"""The elements between the valves and the port: motion ratio, gas spring, seal friction (docs/reference/ports.md).

Standard library only: the FMU contains a copy of this file.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite, tanh


@dataclass(frozen=True, slots=True, repr=False)
class Port:
    """The parameters that all shock laws share.

    Args:
        motion_ratio: Damper travel per port travel [1]: damper velocity = motion_ratio * velocity, port force =
            motion_ratio * damper force.
        compression_scale: Factor on the static force in compression [1].
        rebound_scale: Factor on the static force in rebound [1].
        gas_stiffness: Parallel gas spring at the damper [N/m] (K of Eq 3.14).
        gas_preload: Gas force at zero displacement [N] (F_0 of Eq 3.14).
        seal_friction: Coulomb drag [N] (3.4.3), smoothed as tanh(v / friction_velocity).
        friction_velocity: Width of the smoothing [m/s].

    Raises:
        ValueError: A value is not finite or outside its range; the message names it.
    """

    motion_ratio: float = 1.0
    compression_scale: float = 1.0
    rebound_scale: float = 1.0
    gas_stiffness: float = 0.0
    gas_preload: float = 0.0
    seal_friction: float = 0.0
    friction_velocity: float = 0.005

    def __repr__(self) -> str:
        """Return the parameters that differ from their defaults, as an expression."""
        stated = ((one.name, getattr(self, one.name), one.default) for one in fields(self))
        return f"Port({', '.join(f'{name}={value!r}' for name, value, default in stated if value != default)})"

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not isfinite(getattr(self, name)):
                raise ValueError(f"port: {name} must be finite, not {getattr(self, name)!r}")
        for name in ("motion_ratio", "friction_velocity"):
            if getattr(self, name) <= 0.0:
                raise ValueError(f"port: {name} must be positive, not {getattr(self, name)!r}")
        for name in ("compression_scale", "rebound_scale", "gas_stiffness", "seal_friction"):
            if getattr(self, name) < 0.0:
                raise ValueError(f"port: {name} must not be negative, not {getattr(self, name)!r}")

    def scale(self, damper_velocity: float) -> float:
        """Return the factor on the static force [1] at a damper velocity [m/s]."""
        return self.compression_scale if damper_velocity > 0.0 else self.rebound_scale

    def seal_force(self, damper_velocity: float) -> float:
        """Return the seal drag [N] at a damper velocity [m/s]."""
        return self.seal_friction * tanh(damper_velocity / self.friction_velocity)

    def gas_force(self, displacement: float) -> float:
        """Return the gas force at the damper [N] at a port displacement [m] (Eq 3.14: K x + F_0)."""
        return self.gas_preload + self.gas_stiffness * self.motion_ratio * displacement
