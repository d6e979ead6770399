"""Loops over fmpy's functions, as an experienced user would write them: the arrays for the C calls are created once.

`held` is the usual scheme. The others also set the derivatives of inputs: coupling values and road are straight lines
over a step, and with gauss-seidel the shocks take their inputs from a car that has made the step.
"""

from __future__ import annotations

import shutil
import time as clock
from collections.abc import Callable
from ctypes import c_double, c_int32, c_uint32
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

from benchmarks.engines.runs import CAR_OUTPUTS, CORNERS, DRIVEN, Diverged, Job, Recording

SCHEMES = ("jacobi, held", "jacobi, extrapolated", "gauss-seidel, extrapolated", "gauss-seidel, parabolic")


class Unit:
    """FMU that is ready to initialize."""

    def __init__(self, path: Any, name: str) -> None:
        description = read_model_description(str(path))
        self.folder = extract(str(path))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate()

    def exchange(self, names: tuple[str, ...], values: Any) -> tuple[Any, int, Any]:
        """Return the arguments of fmi2GetReal or fmi2SetReal, using the memory of an array."""
        references = (c_uint32 * len(names))(*(self.references[name] for name in names))
        return references, len(names), (c_double * len(names)).from_buffer(values)

    def derivatives(self, names: tuple[str, ...], slopes: Any) -> tuple[Any, int, Any, Any]:
        """Return the arguments of fmi2SetRealInputDerivatives for first derivatives, using the memory of an array."""
        references, count, values = self.exchange(names, slopes)
        return references, count, (c_int32 * count)(*[1] * count), values

    def close(self) -> None:
        """Free the FMU, whatever its state."""
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


def run(job: Job) -> Recording:
    """Run one scheme."""
    units = {name: Unit(path, name) for name, path in job.fmus.items()}
    try:
        return _run(job, _Car(units))
    finally:
        for unit in units.values():
            unit.close()


class _Car:
    """The car and its shocks, with the memory that their calls read and write.

    `state` holds the car's displacements, its ten outputs (velocities first) and the shocks' forces.
    """

    def __init__(self, units: dict[str, Unit]) -> None:
        self.inputs, self.slopes, self.state = np.zeros(11), np.zeros(11), np.zeros(18)
        self.ports, self.port_slopes = np.zeros(8), np.zeros(8)
        car = units["car"]
        names = (*DRIVEN, *(f"{c}.force" for c in CORNERS))
        self.car, self.component = car.fmu, car.fmu.component
        self._in, self._ramp = car.exchange(names, self.inputs), car.derivatives(names, self.slopes)
        self._out = car.exchange((*(f"{c}.displacement" for c in CORNERS), *CAR_OUTPUTS), self.state[:14])
        self.shocks = [units[c].fmu for c in CORNERS]
        self._plan = [self._calls(units[c], k) for k, c in enumerate(CORNERS)]

    def _calls(self, unit: Unit, k: int) -> tuple[Any, ...]:
        port, own = ("velocity", "displacement"), slice(2 * k, 2 * k + 2)
        end, ramp = unit.exchange(port, self.ports[own]), unit.derivatives(port, self.port_slopes[own])
        start = unit.exchange(("force",), self.state[14 + k : 15 + k])
        return unit.fmu, unit.fmu.component, end, ramp, start

    def read_car(self) -> None:
        self.car.fmi2GetReal(self.component, *self._out)

    def read_shocks(self) -> None:
        for fmu, its, _, _, start in self._plan:
            fmu.fmi2GetReal(its, *start)

    def set_car(self) -> None:
        self.car.fmi2SetReal(self.component, *self._in)

    def ramp_car(self) -> None:
        self.car.fmi2SetRealInputDerivatives(self.component, *self._ramp)

    def set_shocks(self) -> None:
        for fmu, its, end, _, _ in self._plan:
            fmu.fmi2SetReal(its, *end)

    def step_car(self, time: float, h: float) -> None:
        self.car.fmi2DoStep(self.component, time, h, 1)

    def step_shocks(self, time: float, h: float) -> None:
        for fmu, its, _, _, _ in self._plan:
            fmu.fmi2DoStep(its, time, h, 1)

    def ramp_and_step_shocks(self, time: float, h: float) -> None:
        for fmu, its, end, ramp, _ in self._plan:
            fmu.fmi2SetReal(its, *end)
            fmu.fmi2SetRealInputDerivatives(its, *ramp)
            fmu.fmi2DoStep(its, time, h, 1)

    def begin(self, row: Any, stop: float) -> None:
        """Find the equilibrium start: values are passed between the FMUs in initialization mode."""
        everyone = [self.car, *self.shocks]
        for fmu in everyone:
            fmu.setupExperiment(startTime=0.0, stopTime=stop)
            fmu.enterInitializationMode()
        for _ in range(10):
            self.hand_round(row)
            self.set_car()
            self.set_shocks()
            self.read_car()
            self.read_shocks()
        for fmu in everyone:
            fmu.exitInitializationMode()
        self.read_car()
        self.read_shocks()

    def hand_round(self, row: Any) -> None:
        self.inputs[:7], self.inputs[7:] = row, self.state[14:]
        np.take(self.state, _PAIRS, out=self.ports)


#: Positions of the shocks' velocity and displacement in the state, shock by shock.
_PAIRS = np.array([[4 + k, k] for k in range(4)]).ravel()
_FORCES = slice(14, 18)

Step = Callable[[int, float], None]


def _run(job: Job, car: _Car) -> Recording:
    drive, h = job.drive(np.arange(job.count + 1) * job.step), job.step
    rows = np.empty((job.count + 1, 14))
    car.begin(drive[0], job.stop)
    rows[0] = car.state[4:]
    step = _held(car, drive, h) if job.scheme == "jacobi, held" else _ramped(car, drive, h, job.scheme)
    began = clock.process_time()
    try:
        for k in range(job.count):
            step(k, k * h)
            rows[k + 1] = car.state[4:]
    except FMICallException as error:
        raise Diverged(str(error)) from error
    seconds = clock.process_time() - began
    return Recording(np.arange(job.count + 1) * h, rows.T, seconds, job.count, job.rate)


def _held(car: _Car, drive: Any, h: float) -> Step:
    """Step all FMUs with the values at the start of the step."""

    def step(k: int, time: float) -> None:
        car.hand_round(drive[k])
        car.set_car()
        car.set_shocks()
        car.step_car(time, h)
        car.step_shocks(time, h)
        car.read_car()
        car.read_shocks()

    return step


def _ramped(car: _Car, drive: Any, h: float, scheme: str) -> Step:
    """Step with straight lines: extrapolated ones, or with the mean of a parabola (cosim/engine/sweep.py)."""
    order, kind = scheme.split(", ")
    roads, per_second = np.diff(drive, axis=0) / h, 1.0 / h
    parabolic, first_car = kind == "parabolic", order == "gauss-seidel"
    now, ahead = car.state.copy(), car.state
    past, older = now.copy(), now.copy()

    def line(s: Any, end: Any) -> tuple[Any, Any]:
        """Return the starts and slopes of signals with this end value."""
        start = now[s] - (end - now[s] - (now[s] - past[s])) / 6.0 if parabolic else now[s]
        return start, (end - start) * per_second

    def supposed(s: Any) -> Any:
        end = now[s] + (now[s] - past[s])
        return end + (now[s] - past[s]) - (past[s] - older[s]) if parabolic else end

    def step(k: int, time: float) -> None:
        car.inputs[:7], car.slopes[:7] = drive[k], roads[k]
        car.inputs[7:], car.slopes[7:] = line(_FORCES, supposed(_FORCES))
        car.set_car()
        car.ramp_car()
        car.step_car(time, h)
        if first_car:
            car.read_car()
        car.ports[:], car.port_slopes[:] = line(_PAIRS, ahead[_PAIRS] if first_car else supposed(_PAIRS))
        car.ramp_and_step_shocks(time, h)
        if not first_car:
            car.read_car()
        car.read_shocks()
        older[:], past[:], now[:] = past, now, ahead

    return step
