"""A loop over fmpy's functions, as one writes it who knows fmpy: the arrays that the C calls take are made once."""

from __future__ import annotations

import shutil
import time as clock
from ctypes import c_double, c_uint32
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

from benchmarks.engines.job import CAR_OUTPUTS, CORNERS, DRIVEN, Diverged, Job, Recording


class Unit:
    """An FMU that is ready to initialize."""

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
        """The arguments of fmi2GetReal or fmi2SetReal, over the memory of an array."""
        references = (c_uint32 * len(names))(*(self.references[name] for name in names))
        return references, len(names), (c_double * len(names)).from_buffer(values)

    def close(self) -> None:
        """Free it, whatever state it is in."""
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


def run(job: Job) -> Recording:
    """Step all with the values of the step's start."""
    units = {name: Unit(path, name) for name, path in job.fmus.items()}
    try:
        return _run(job, units)
    finally:
        for unit in units.values():
            unit.close()


def _run(job: Job, units: dict[str, Unit]) -> Recording:
    drive = job.drive(np.arange(job.count) * job.step)
    inputs, state, ports = np.zeros(11), np.zeros(18), np.zeros(8)  # state: displacements, ten outputs, forces
    pairs = np.array([[4 + k, k] for k in range(4)]).ravel()
    car, shocks = units["car"].fmu, [units[c].fmu for c in CORNERS]
    car_in = units["car"].exchange((*DRIVEN, *(f"{c}.force" for c in CORNERS)), inputs)
    car_out = units["car"].exchange((*(f"{c}.displacement" for c in CORNERS), *CAR_OUTPUTS), state[:14])
    ends = [units[c].exchange(("velocity", "displacement"), ports[2 * k : 2 * k + 2]) for k, c in enumerate(CORNERS)]
    starts = [units[c].exchange(("force",), state[14 + k : 15 + k]) for k, c in enumerate(CORNERS)]
    plan = [(fmu, fmu.component, end, start) for fmu, end, start in zip(shocks, ends, starts, strict=True)]
    rows = np.empty((job.count + 1, 14))
    component, h, everyone = car.component, job.step, [car, *shocks]

    def read() -> None:
        car.fmi2GetReal(component, *car_out)
        for fmu, its, _, start in plan:
            fmu.fmi2GetReal(its, *start)

    def write(row: Any) -> None:
        inputs[:7], inputs[7:] = row, state[14:]
        car.fmi2SetReal(component, *car_in)
        np.take(state, pairs, out=ports)
        for fmu, its, end, _ in plan:
            fmu.fmi2SetReal(its, *end)

    for fmu in everyone:
        fmu.setupExperiment(startTime=0.0, stopTime=job.stop)
        fmu.enterInitializationMode()
    for _ in range(10):  # the common start: values are handed round in initialization mode
        write(drive[0])
        read()
    for fmu in everyone:
        fmu.exitInitializationMode()
    read()
    rows[0] = state[4:]
    with job.stepping():
        began = clock.perf_counter()
        try:
            for k in range(job.count):
                write(drive[k])
                time = k * h
                car.fmi2DoStep(component, time, h, 1)
                for fmu, its, _, _ in plan:
                    fmu.fmi2DoStep(its, time, h, 1)
                read()
                rows[k + 1] = state[4:]
        except FMICallException as error:
            raise Diverged(str(error)) from error
        seconds = clock.perf_counter() - began
    return Recording(np.arange(job.count + 1) * h, rows.T, seconds, job.count, job.rate)
