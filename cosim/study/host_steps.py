"""Steps for a host that integrates a car and imports its shocks: what each loop of docs/how_to/hosts.md allows.

The host integrates the linear car of a vehicle FMU with the classical Runge-Kutta method; the FMUs of the shocks give
the forces in the loops J, A, B and C. Errors are those against loop C at a step far below, where it has converged to
the solution of the whole car as one system.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.components.fmu_component import FmuComponent
from cosim.force_law import ExtrapolatedForce, ForceLaw, ForceLoop, HeldForce
from cosim.session.run import Case
from cosim.study.running.machine import WiredCar, read_vehicle, shock_of
from cosim.systems.coupling import Coupling, Scenario
from eightpost.array_types import Array
from eightpost.errors import InputError, StepError
from eightpost.machine import NotInBatchError

# ==== The linear car of a vehicle FMU as a host integrates it ========================================================

#: Weights of the force at the start of a step, and of that one step before, in the loops that hold one.
_HELD = {"J": (0.0, 1.0), "A": (1.0, 0.0), "B": (1.5, -0.5)}

#: Steps between which the limit of stability is sought [s].
_STEPS = np.geomspace(1e-5, 0.1, 81)

#: States and forces at the end of step k by those at its start.
_Advance = Callable[[int, Array, Array], tuple[Array, Array]]


class _HostMotion(NamedTuple):
    """Motion of a car at the start and at the ends of K steps."""

    compared: Array  #: Outputs that are compared (K + 1, p).
    velocity: Array  #: Shock velocities (K + 1, C) [m/s].


class _HostCar:
    """Linear car x' = A x + B u of a host on a drive, without the friction and the springs at its ports.

    Args:
        wired: Vehicle and its ports.
        scenario: Scenario with the drive.

    Attributes:
        quantity: Name of the outputs that are compared. A vehicle without tire forces is compared by shock velocities.
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

    def run(self, loop: str, shocks: ForceLaw | HeldForce | ExtrapolatedForce, step: float, count: int) -> _HostMotion:
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
        return _HostMotion(outputs[:, self._compared], outputs[:, self._velocities])

    def _start(self, shocks: ForceLaw | HeldForce | ExtrapolatedForce, inputs: Array) -> tuple[Array, Array]:
        """Start the shocks at rest under the first inputs, or at zero; return states and forces there."""
        car, count = self._vehicle, len(self._forces)
        state = np.zeros(len(car.A))
        for _ in range(8 if car.at_rest else 1):  # a gas force follows the travel, and is small beside the springs
            travel = (car.C[self._motions] @ state + self._direct(self._motions, inputs))[count:]
            force = np.asarray(shocks.start(0.0, np.zeros(count), travel))
            if car.at_rest:
                state = np.linalg.solve(car.A, -(car.B @ inputs + self._pushed @ force))
        return np.asarray(state, dtype=np.float64), force

    def _with_law(self, shocks: ForceLaw, step: float, inputs: Array) -> _Advance:
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


# ==== Steps ==========================================================================================================

#: Loops, from the poorest to the best.
LOOPS = ("J", "A", "B", "C")

#: Tolerated errors in percent of the standard deviation, from the largest.
LIMITS = (5.0, 0.5, 0.1)

#: Step of the reference [s], and the steps that are tried as multiples of it.
_FINE = 1e-4
_LADDER = (1, 2, 3, 4, 5, 7, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 120, 150, 200)

#: Start of the comparison, and its longest duration [s].
_SETTLING, _SECONDS = 0.5, 2.0

#: Number of intervals of the velocity from which the largest damping is taken.
_CHORDS = 80


@dataclass(frozen=True)
class HostSteps:
    """Largest steps of a host's loops for one car."""

    car: str  #: Component of the vehicle.
    quantity: str  #: Compared outputs: tire force, or shock velocity for a vehicle without tire forces.
    seconds: float  #: Length of the drive that was compared [s].
    damping: tuple[float, ...]  #: Largest damping of each shock over the velocities of the drive [N.s/m].
    stable: Mapping[str, float]  #: Step up to which a loop is stable with this damping [s], by loop.
    steps: Mapping[str, tuple[float, ...]]  #: Largest step for each of LIMITS [s], by loop; 0 if none of the tried is.


def host_steps(case: Case) -> HostSteps:
    """Find the steps for the car, the shocks and the drive of a system.

    Raises:
        InputError: The system is not one vehicle of this project with shocks at its ports, or its drive does not move
            the car.
        FmuError: A shock cannot save its state.
    """
    try:
        wired = _wired(case)
    except NotInBatchError as error:
        raise InputError(
            f"{case.name}: {error}; host steps need one vehicle built by eightpost, not confidential, and its shocks"
        ) from error
    trial = _Trial(case, wired)
    stable = {loop: trial.car.largest_stable_step(loop, trial.damping) for loop in LOOPS}
    return HostSteps(
        wired.name,
        trial.car.quantity,
        trial.seconds - trial.settling,
        tuple(trial.damping.tolist()),
        stable,
        {loop: tuple(trial.largest(loop, limit, stable[loop]) for limit in LIMITS) for loop in LOOPS},
    )


def _wired(case: Case) -> WiredCar:
    system, vehicles = case.system, {bond.velocity.source.partition(".")[0] for bond in case.system.bonds}
    if len(vehicles) != 1:
        raise NotInBatchError(f"shocks are bonded to {len(vehicles)} vehicles")
    (name,) = vehicles
    component = system.components[name]
    if not isinstance(component, FmuComponent):
        raise NotInBatchError(f"{name} runs in a process of its own")
    vehicle = read_vehicle(component, case.fmus[name], system.parameters.get(name, {}))
    return WiredCar(system, Coupling(system, case.scenario).feeds, name, vehicle)


class _Trial:
    """Runs of a host with each loop and step, compared with the reference."""

    def __init__(self, case: Case, wired: WiredCar) -> None:
        self.car = _HostCar(wired, case.scenario)
        self.seconds = min(case.scenario.stop, _SETTLING + _SECONDS)
        self.settling = min(_SETTLING, 0.5 * self.seconds)
        self._corners = [shock_of(bond) for bond in case.system.bonds]
        self._fmus = [case.fmus[name] for name in self._corners]
        self._parameters = {name: case.system.parameters.get(name, {}) for name in self._corners}
        self._errors: dict[tuple[str, int], float] = {}
        with self._opened("C") as shocks:
            self._true = self.car.run("C", shocks, _FINE, round(self.seconds / _FINE))
            self._spread = self._true.compared[round(self.settling / _FINE) :].std(axis=0)
            if not self._spread.min() > 0.0:
                raise InputError(
                    f"{case.name}: the first {self.seconds:g} s of the drive do not move every corner; set drive_start"
                )
            self.damping = self._largest_damping(shocks)

    def _opened(self, loop: str) -> ForceLaw | HeldForce | ExtrapolatedForce:
        kinds: Mapping[str, type[ForceLaw | HeldForce | ExtrapolatedForce]] = {"B": ExtrapolatedForce, "C": ForceLaw}
        return kinds.get(loop, HeldForce)(self._fmus, corners=self._corners, parameters=self._parameters)

    def _largest_damping(self, shocks: ForceLoop) -> Array:
        """Return the steepest chord of each shock's steady force (C,) [N.s/m] over the velocities of the reference."""
        fastest = np.abs(self._true.velocity).max(axis=0)
        speeds = np.linspace(-fastest, fastest, _CHORDS + 1)
        forces = np.array([shocks.start(0.0, row) for row in speeds])
        slopes: Array = np.diff(forces, axis=0) / np.diff(speeds, axis=0)
        steepest: Array = slopes.max(axis=0)
        return steepest

    def largest(self, loop: str, limit: float, stable: float) -> float:
        """Return the largest stable step that is tried [s] with an error of at most the limit [%], or 0."""
        low = 0  # steps before this place are good, those from `high` on are not
        high = sum(multiple * _FINE <= stable for multiple in _LADDER)
        while low < high:
            middle = (low + high) // 2
            low, high = (middle + 1, high) if self.error(loop, _LADDER[middle]) <= limit else (low, middle)
        return round(_LADDER[low - 1] * _FINE, 9) if low else 0.0

    def error(self, loop: str, multiple: int) -> float:
        """Return the error [%] of a loop at a multiple of the reference's step; infinite if it diverges."""
        if (loop, multiple) not in self._errors:
            step = multiple * _FINE
            with np.errstate(all="ignore"), self._opened(loop) as shocks:
                try:
                    found = self.car.run(loop, shocks, step, int(self.seconds / step + 1e-9))
                    self._errors[loop, multiple] = self._apart(found, multiple)
                except (StepError, InputError):  # the FMU refuses what is not finite
                    self._errors[loop, multiple] = np.inf
        return self._errors[loop, multiple]

    def _apart(self, found: _HostMotion, multiple: int) -> float:
        first = int(np.ceil(self.settling / (multiple * _FINE) - 1e-9))
        true = self._true.compared[::multiple][: len(found.compared)]
        missed = np.sqrt(np.mean((found.compared - true)[first:] ** 2, axis=0)) / self._spread
        worst = 100.0 * float(missed.max())
        return worst if np.isfinite(worst) else np.inf
