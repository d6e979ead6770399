"""A linear vehicle with ports: x' = A x + B u, y = C x + D u + offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from eightpost.array_types import Array

#: No friction and no spring, in the order of PortFriction in fmus/machine/car.h.
_FREE = (0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class Port:
    """A port of a vehicle for a shock."""

    force: int  #: Number of the force's input.
    velocity: int  #: Number of the velocity's output.
    travel: int | None  #: Number of the travel's output; None if nothing depends on it.
    friction: tuple[float, ...] = _FREE  #: Friction and spring, in the order of PortFriction in fmus/machine/car.h.

    @property
    def has_forces(self) -> bool:
        """Whether the port has friction or a spring."""
        return self.friction[0] != 0.0 or self.friction[2] != 0.0 or self.friction[6] != 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Vehicle:
    """A vehicle in SI units."""

    A: Array  #: (n, n).
    B: Array  #: (n, m).
    C: Array  #: (p, n).
    D: Array  #: (p, m).
    offset: Array  #: Added to the outputs (p,).
    at_rest: bool  #: Whether it starts at rest under its loads, or else with states of zero.

    def with_dampers(self, ports: Sequence[Port], damping: Array) -> Vehicle:
        """Return the vehicle with linear dampers (P,) [N.s/m] at ports whose velocities no force changes at once."""
        forces, velocities = [port.force for port in ports], [port.velocity for port in ports]
        by_states, direct = damping[:, None] * self.C[velocities], damping[:, None] * self.D[velocities]
        B, D = self.B[:, forces], self.D[:, forces]
        return replace(
            self, A=self.A + B @ by_states, B=self.B + B @ direct, C=self.C + D @ by_states, D=self.D + D @ direct
        )
