"""Steps for a host that integrates a car and imports its shocks: what each loop of docs/how_to/hosts.md allows.

The host integrates the linear car of a vehicle FMU with the classical Runge-Kutta method; the FMUs of the shocks give
the forces in the loops J, A, B and C. Errors are those against loop C at a step far below, where it has converged to
the solution of the whole car as one system.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim.components.fmu_component import FmuComponent
from cosim.force_law import ExtrapolatedForce, ForceLaw, ForceLoop, HeldForce
from cosim.session.run import Case
from cosim.study.machine.car import read_vehicle
from cosim.study.machine.host_car import HostCar, HostMotion
from cosim.study.machine.wiring import WiredCar, shock_of
from cosim.systems.coupling import Coupling
from eightpost.array_types import Array
from eightpost.errors import InputError, StepError
from eightpost.machine import NotInBatchError

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
        self.car = HostCar(wired, case.scenario)
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

    def _apart(self, found: HostMotion, multiple: int) -> float:
        first = int(np.ceil(self.settling / (multiple * _FINE) - 1e-9))
        true = self._true.compared[::multiple][: len(found.compared)]
        missed = np.sqrt(np.mean((found.compared - true)[first:] ** 2, axis=0)) / self._spread
        worst = 100.0 * float(missed.max())
        return worst if np.isfinite(worst) else np.inf
