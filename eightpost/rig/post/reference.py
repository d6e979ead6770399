"""Reference integration in numpy: velocity Verlet with a fixed step, for all runs in parallel arrays.

    q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h a),  v+ = v + h/2 (a + a+)

The method is of second order; shocks and friction have exponential integrators. `kernel.py` computes the same steps as
compiled code.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.rig.post.drive import RATE
from eightpost.rig.post.shocks import ShockSet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.rig.post.car import Car
    from eightpost.rig.post.drive import Drives
    from eightpost.rig.post.shocks import Shock

    Array = NDArray[np.float64]


def reference_march(car: Car, shocks: Sequence[Sequence[Shock]], drives: Drives) -> list[Array]:
    """Return the records (N, 3 D + 3 C) of each run: q, q', q'', shock, friction and tire forces.

    Args:
        car: Car to simulate.
        shocks: Shocks at the corners for each run.
        drives: Drives of the runs.
    """
    runs, steps = len(drives.values), drives.weights.shape[1]
    stepper = _Stepper(car, ShockSet(shocks), 1.0 / (RATE * steps), runs)
    records = np.empty((drives.samples, 3 * car.mass.size + 3 * len(car.corners), runs))
    for sample in range(-drives.lead, drives.samples):
        if sample >= 0:
            records[sample] = stepper.record()
        values, slopes = drives.between(sample)
        for k in range(steps):
            stepper.step(values[k], slopes[k])
    return [records[: len(values), :, i] for i, values in enumerate(drives.values)]


class _Stepper:
    """States of all runs, and their integration by one step."""

    def __init__(self, car: Car, shocks: ShockSet, step: float, runs: int) -> None:
        self._car, self._shocks, self._step = car, shocks, step
        dofs, corners = car.mass.size, len(car.corners)
        self._corners = corners
        self.q, self.v, self.a = (np.zeros((dofs, runs)) for _ in range(3))
        self._speed, self._bend = np.zeros((corners, runs)), np.zeros((corners, runs))
        self._shock_force, self._friction, self._tire = (np.zeros((corners, runs)) for _ in range(3))
        self._ports = np.vstack([car.shock, car.wheel, car.spring])
        inverse = (1.0 / car.mass)[:, None]
        self._push = inverse * np.hstack([-car.shock.T, car.wheel.T, -car.spring.T, car.load.T])
        self._stiffness, self._damping = -inverse * car.stiffness, -inverse * car.damping
        self._linear = bool(np.any(car.stiffness) or np.any(car.damping))

    def record(self) -> Array:
        """Return q, v, a, shock, friction and tire forces, stacked (3 D + 3 C, B)."""
        return np.vstack([self.q, self.v, self.a, self._shock_force, self._friction, self._tire])

    def step(self, drive: Array, slope: Array) -> None:
        """Advance by one step, at whose end the inputs are `drive` (U, B) with the slope `slope` (U, B) [1/s]."""
        h, car, n = self._step, self._car, self._corners
        self.q = self.q + h * (self.v + (0.5 * h) * self.a)
        guess = self.v + h * self.a
        places, speeds = self._ports @ self.q, self._ports @ guess
        speed = speeds[:n]
        self._shock_force = self._shocks.advance(self._speed, speed, places[:n], h)
        self._bend = car.friction.bend(self._bend, 0.5 * (self._speed + speed), h)
        self._friction = car.friction.force(self._bend)
        self._tire = car.tires.force(drive[:n] - places[n : 2 * n], slope[:n] - speeds[n : 2 * n])
        spring = car.springs.force(places[2 * n :])
        forces = np.vstack([self._shock_force + self._friction, self._tire, spring, drive[n:]])
        a = self._push @ forces
        if self._linear:
            a = a + self._stiffness @ self.q + self._damping @ guess
        self.v = self.v + (0.5 * h) * (self.a + a)
        self.a, self._speed = a, self._ports[:n] @ self.v
