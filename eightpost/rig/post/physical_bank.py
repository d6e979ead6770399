"""Physical dampers on the virtual rig: equations of `eightpost.rig.damper`, integrated with a Rosenbrock method."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.damper import PhysicalDamper

    Array = NDArray[np.float64]

#: The L-stable second-order method ROS2.
_GAMMA = 1.0 + math.sqrt(0.5)


class PhysicalBank:
    """K ports with the same physical damper; each has its own chamber levels and gas volume."""

    def __init__(self, damper: PhysicalDamper, ports: int) -> None:
        """Initialise every damper at rest at mid-travel."""
        self._damper, self._ports = damper, ports
        self._states = np.array([damper._rest(0.0)] * ports)
        self._places, self._drag = np.zeros(ports), np.zeros(ports)
        self._now = (0.0, 0.0)
        self._rates = damper.plant.rates(self._motion)
        self._jacobian = damper.plant.jacobian(self._motion)

    def _motion(self, t: float) -> tuple[float, float]:
        return self._now

    def advance(self, before: Array, after: Array, displacement: Array, step: float) -> Array:
        """Return the forces (K,) [N] after a step; see `Bank.advance` for the arguments."""
        for k in range(self._ports):
            self._now = (float(displacement[k]), 0.5 * (float(before[k]) + float(after[k])))
            self._states[k] = self._step(self._states[k], step)
        self._update_drag(displacement)
        return self._force()

    def _step(self, states: Array, step: float) -> Array:
        """Return the states after a step at a constant velocity."""
        matrix = np.eye(3) - step * _GAMMA * np.array(self._jacobian(states, 0.0))
        first = np.linalg.solve(matrix, np.array(self._rates(states, 0.0)))
        second = np.array(self._rates(states + step * first, 0.0)) - 2.0 * first
        return np.asarray(states + step * (1.5 * first + 0.5 * np.linalg.solve(matrix, second)))

    def _update_drag(self, displacement: Array) -> None:
        """Update the Dahl friction of the seals to new displacements (K,) [m]."""
        seals, moved = self._damper.seals, displacement - self._places
        end = np.copysign(seals.drag, moved)
        self._drag = end + (self._drag - end) * np.exp(-np.abs(moved) / seals.length)
        self._places = displacement

    def _force(self) -> Array:
        damper = self._damper
        fluid, cylinder = damper.fluid, damper.cylinder
        pressures = fluid.vapour_pressure + fluid.span * np.exp(self._states[:, :2])
        ends = pressures[:, 0] * cylinder.compression_area - pressures[:, 1] * cylinder.rebound_area
        return np.asarray(ends + damper.plant.force(0.0, 0.0) + self._drag)
