"""Container FMU of fmu-manipulation-toolbox with car and shocks, run by fmpy."""

from __future__ import annotations

import logging
import shutil
import time as clock
from pathlib import Path

import numpy as np
from fmpy.fmi1 import FMICallException
from fmu_manipulation_toolbox.container import FMUContainer

from benchmarks.engines.fmpy_loop import Unit
from benchmarks.engines.job import CONNECTIONS, DRIVEN, RECORDED, Diverged, Job, Recording


def run(job: Job) -> Recording:
    """Build the container and step it."""
    unit = Unit(_container(job), "container")
    try:
        return _run(job, unit)
    finally:
        unit.close()


def _run(job: Job, unit: Unit) -> Recording:
    drive = job.drive(np.arange(job.count) * job.step)
    inputs, rows = np.zeros(7), np.empty((job.count + 1, 14))
    outputs = np.zeros(14)
    to, of = unit.exchange(DRIVEN, inputs), unit.exchange(tuple(map(_name, RECORDED)), outputs)
    fmu, h = unit.fmu, job.step
    component = fmu.component
    fmu.setupExperiment(startTime=0.0, stopTime=job.stop)
    inputs[:] = drive[0]
    fmu.fmi2SetReal(component, *to)
    fmu.enterInitializationMode()
    fmu.fmi2SetReal(component, *to)
    fmu.exitInitializationMode()
    fmu.fmi2GetReal(component, *of)
    rows[0] = outputs
    with job.stepping():
        began = clock.process_time()
        try:
            for k in range(job.count):
                inputs[:] = drive[k]
                fmu.fmi2SetReal(component, *to)
                fmu.fmi2DoStep(component, k * h, h, 1)
                fmu.fmi2GetReal(component, *of)
                rows[k + 1] = outputs
        except FMICallException as error:
            raise Diverged(str(error)) from error
        seconds = clock.process_time() - began
    return Recording(np.arange(job.count + 1) * h, rows.T, seconds, job.count, job.rate)


def _container(job: Job) -> Path:
    logging.getLogger("fmu_manipulation_toolbox").setLevel(logging.ERROR)
    folder = Path(job.work)
    for name, fmu in job.fmus.items():
        shutil.copy(fmu, folder / f"{name}.fmu")
    container = FMUContainer("container", folder)
    for name in job.fmus:
        container.get_fmu(f"{name}.fmu")
    for (a, x), (b, y) in CONNECTIONS:
        container.add_link(f"{a}.fmu", x, f"{b}.fmu", y)
    for name in DRIVEN:
        container.add_input(name, "car.fmu", name)
    for component, name in RECORDED:
        container.add_output(f"{component}.fmu", name, _name((component, name)))
    container.make_fmu("container.fmu", step_size=job.step, sequential=job.scheme.startswith("gauss"))
    return folder / "container.fmu"


def _name(output: tuple[str, str]) -> str:
    """Return the name in the container; that of the connected variable, which the container also lists, differs."""
    return "recorded." + ".".join(output)
