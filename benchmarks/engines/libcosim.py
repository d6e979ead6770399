"""The engine libcosim, through libcosimpy: fixed steps, and ECCO, which controls the step by the bonds' energy."""

from __future__ import annotations

import time as clock
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import read_model_description
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from benchmarks.engines.job import CONNECTIONS, DRIVE_CONNECTIONS, RECORDED, Diverged, Job, Recording


def run(job: Job) -> Recording:
    """Run in one call."""
    log_output_level(CosimLogLevel.FATAL)
    execution = CosimExecution.from_step_size(round(job.step * 1e9))
    fmus = job.fmus | {"drive": Path(job.folder) / "drive.fmu"}
    slaves = {name: CosimLocalSlave(str(path), name) for name, path in fmus.items()}
    index = {name: execution.add_local_slave(slave) for name, slave in slaves.items()}
    references = {name: _references(path) for name, path in fmus.items()}

    def end(component: str, name: str) -> tuple[int, int]:
        return index[component], references[component][name]

    for source, target in (*CONNECTIONS, *DRIVE_CONNECTIONS):
        if execution.connect_real_variables(*end(*source), *end(*target)) != 0:
            raise RuntimeError(f"libcosim refused the connection of {source} to {target}")
    observer = CosimObserver.create_time_series(job.count + 2)
    execution.add_observer(observer)
    for one in RECORDED:
        observer.start_time_series(*end(*one), CosimVariableType.REAL)
    with job.stepping():
        began = clock.process_time()
        if not execution.step(job.count):
            raise Diverged("libcosim: a step failed")
        seconds = clock.process_time() - began
    columns = [observer.time_series_real_samples(*end(*one), from_step=1, sample_count=job.count) for one in RECORDED]
    time = np.array(columns[0][0]) * 1e-9
    return Recording(time, np.array([c[2] for c in columns]), seconds, job.count, job.rate)


def _references(path: Path) -> dict[str, Any]:
    return {v.name: v.valueReference for v in read_model_description(str(path)).modelVariables}
