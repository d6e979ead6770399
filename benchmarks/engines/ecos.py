"""The engine ecos, through ecospy's functions in this process."""

from __future__ import annotations

import time as clock
from pathlib import Path

import numpy as np
from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure

from benchmarks.engines.job import CONNECTIONS, DRIVE_CONNECTIONS, RECORDED, Diverged, Job, Recording


def run(job: Job) -> Recording:
    """Run in one call; signals that are not recorded have no values."""
    EcosLib.set_log_level("off")
    table, recorded = Path(job.work) / "ecos.csv", "nothing" not in job.scheme
    structure = EcosSimulationStructure()
    for name, path in (job.fmus | {"drive": Path(job.folder) / "drive.fmu"}).items():
        structure.add_model(name, str(path))
    for (a, x), (b, y) in (*CONNECTIONS, *DRIVE_CONNECTIONS):
        structure.make_real_connection(f"{a}::{x}", f"{b}::{y}")
    simulation = EcosSimulation(step_size=job.step, structure=structure)
    if recorded:
        simulation.add_csv_writer(str(table), identifiers=[f"{component}::{name}" for component, name in RECORDED])
    if not simulation.init():
        raise RuntimeError(f"ecos: {EcosLib.get_last_error()}")
    with job.stepping():
        began = clock.process_time()
        reached = simulation.step(job.count)
        seconds = clock.process_time() - began
    if abs(reached - job.stop) > job.step:
        raise Diverged(f"ecos ended at {reached} s")
    simulation.terminate()
    simulation.free()
    if not recorded:
        return Recording(np.zeros(0), np.zeros((14, 0)), seconds, job.count, job.rate)
    with table.open() as file:
        heads = [head.strip().removesuffix("[REAL]") for head in file.readline().split(",")]
        rows = np.loadtxt(file, delimiter=",")
    wanted = [heads.index(f"{component}::{name}") for component, name in RECORDED]
    return Recording(rows[:, heads.index("time")], rows[:, wanted].T, seconds, job.count, job.rate)
