"""The linear car of a vehicle FMU as a host integrates it, with shocks that give their forces in a loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from cosim.force_law import ExtrapolatedForce, ForceLaw, HeldForce
from cosim.study.machine.wiring import WiredCar
from cosim.systems.coupling import Scenario
from eightpost.array_types import Array

#: Weights of the force at the start of a step, and of that one step before, in the loops that hold one.
_HELD = {"J": (0.0, 1.0), "A": (1.0, 0.0), "B": (1.5, -0.5)}

#: Steps between which the limit of stability is sought [s].
_STEPS = np.geomspace(1e-5, 0.1, 81)

#: States and forces at the end of step k by those at its start.
_Advance = Callable[[int, Array, Array], tuple[Array, Array]]


class HostMotion(NamedTuple):
    """Motion of a car at the start and at the ends of K steps."""

    compared: Array  #: Outputs that are compared (K + 1, p).
    velocity: Array  #: Shock velocities (K + 1, C) [m/s].


class HostCar:
    """Linear car x' = A x + B u of a host on a drive, without the friction and the springs at its ports.

    Args:
        wired: Vehicle and its ports.
        scenario: Scenario with the drive.

    Attributes:
        quantity: Which outputs are compared: tire forces, or without any the shock velocities.
    """

    def __init__(self, wired: WiredCar, scenario: Scenario) -> None:
        self._wired, self._scenario, self._vehicle = wired, scenario, wired.vehicle
        tires = [k for k, name in enumerate(wired.vehicle.outputs) if name.rpartition(".")[2] == "tire_force"]
        self.quantity = "tire force" if tires else "shock velocity"
        self._velocities = [port.velocity for port in wired.ports]
        self._motions = self._velocities + [int(port.travel or 0) for port in wired.ports]
        self._compared, self._forces = tires or self._velocities, [port.force for port in wired.ports]
        self._pushed = wired.vehicle.B[:, self._forces]

    # ---- Runs of the classical Runge-Kutta method -------------------------------------------------------------------

    def run(self, loop: str, shocks: ForceLaw | HeldForce | ExtrapolatedForce, step: float, count: int) -> HostMotion:
        """Return the motion over `count` steps [s] with a loop of docs/how_to/hosts.md.

        Raises:
            StepError: A shock refuses a step.
            InputError: The integration diverges.
        """
        inputs = self._wired.inputs(self._scenario, np.linspace(0.0, step * count, 2 * count + 1))
        state, force = self._start(shocks, inputs[0])
        rows, forces = [state], [force]
        if isinstance(shocks, ForceLaw):
            advance = self._with_law(shocks, step, inputs)
        else:
            advance = self._with_held_force(loop, shocks, step, inputs, force)
        for k in range(count):
            state, force = advance(k, state, force)
            rows.append(state)
            forces.append(force)
        outputs = np.array(rows) @ self._vehicle.C.T + self._direct(slice(None), inputs[::2])
        outputs += np.array(forces) @ self._vehicle.D[:, self._forces].T
        return HostMotion(outputs[:, self._compared], outputs[:, self._velocities])

    def _start(self, shocks: ForceLaw | HeldForce | ExtrapolatedForce, inputs: Array) -> tuple[Array, Array]:
        """Start the shocks at rest under the first inputs, or at zero; return states and forces there."""
        car, count = self._vehicle, len(self._forces)
        state = np.zeros(len(car.A))
        for _ in range(8 if car.at_rest else 1):  # a gas force follows the travel, and is small beside the springs
            travel = (car.C[self._motions] @ state + self._direct(self._motions, inputs))[count:]
            force = np.asarray(shocks.start(0.0, np.zeros(count), travel))
            if car.at_rest:
                state = np.linalg.solve(car.A, -(car.B @ inputs + self._pushed @ force))
        return state, force

    def _with_law(self, shocks: ForceLaw, step: float, inputs: Array) -> _Advance:
        """Ask for the force at every stage (loop C)."""
        A, B, ports = self._vehicle.A, self._pushed, self._vehicle.C[self._motions]
        load, moved = inputs @ self._vehicle.B.T, self._direct(self._motions, inputs)
        half = 0.5 * step

        def force_at(call: Callable[[float, Array, Array], Array], n: int, x: Array) -> Array:
            return call(half * n, *(ports @ x + moved[n]).reshape(2, -1))

        def slope(n: int, x: Array) -> Array:
            rate: Array = A @ x + load[n] + B @ force_at(shocks.force, n, x)
            return rate

        def advance(k: int, x: Array, _: Array) -> tuple[Array, Array]:
            a = slope(2 * k, x)
            b = slope(2 * k + 1, x + half * a)
            c = slope(2 * k + 1, x + half * b)
            d = slope(2 * k + 2, x + step * c)
            x = x + step / 6.0 * (a + 2.0 * (b + c) + d)
            return x, force_at(shocks.accept, 2 * k + 2, x)

        return advance

    def _with_held_force(
        self, loop: str, shocks: HeldForce | ExtrapolatedForce, step: float, inputs: Array, first: Array
    ) -> _Advance:
        """Hold one force over every step (loops J, A and B): the step of a linear car is a product of matrices."""
        ports, moved = self._vehicle.C[self._motions], self._direct(self._motions, inputs[::2])
        turn, weight = _over_a_step(step * self._vehicle.A)
        push, z = step * weight @ self._pushed, step * self._vehicle.A.T
        load = inputs @ self._vehicle.B.T
        a, middle = load[:-1:2], load[1::2]
        b = middle + 0.5 * a @ z
        c = middle + 0.5 * b @ z
        loads = step / 6.0 * (a + 2.0 * (b + c) + load[2::2] + c @ z)
        last = first

        def advance(k: int, x: Array, _: Array) -> tuple[Array, Array]:
            nonlocal last
            before, last = last, shocks.step(step * k, step, *(ports @ x + moved[k]).reshape(2, -1))
            held = before if loop == "J" else last
            return turn @ x + push @ held + loads[k], held

        return advance

    def _direct(self, rows: Sequence[int] | slice, inputs: Array) -> Array:
        found: Array = inputs @ self._vehicle.D[rows].T + self._vehicle.offset[rows]
        return found

    # ---- Stability --------------------------------------------------------------------------------------------------

    def largest_stable_step(self, loop: str, damping: Array) -> float:
        """Return the step [s] up to which a loop does not grow, with linear dampers (C,) [N.s/m] as shocks."""
        pull = self._pushed @ (damping[:, None] * self._vehicle.C[self._velocities])

        def grows(step: float) -> bool:
            growth = np.abs(np.linalg.eigvals(self._loop_over_a_step(loop, pull, step))).max()
            return bool(growth > 1.0 + 1e-3 * step)

        last = next((k for k, step in enumerate(_STEPS) if grows(step)), None)
        if not last:
            return float(_STEPS[-1]) if last is None else 0.0
        low, high = _STEPS[last - 1], _STEPS[last]
        for _ in range(8):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if grows(middle) else (middle, high)
        return float(low)

    def _loop_over_a_step(self, loop: str, pull: Array, step: float) -> Array:
        """Return the matrix of a step, for the states and, in a loop that holds the force, those before them."""
        if loop not in _HELD:
            return _over_a_step(step * (self._vehicle.A + pull))[0]
        turn, weight = _over_a_step(step * self._vehicle.A)
        (now, before), held, one = _HELD[loop], step * weight @ pull, np.eye(len(turn))
        return np.block([[turn + now * held, before * held], [one, np.zeros_like(one)]])


def _over_a_step(z: Array) -> tuple[Array, Array]:
    """Return the classical Runge-Kutta step of x' = (z / h) x + b as matrices: on the states, and on h b."""
    one = np.eye(len(z))
    weight = one + z @ (one / 2.0 + z @ (one / 6.0 + z / 24.0))
    return one + z @ weight, weight
