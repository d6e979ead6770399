"""The master of FMPy: fmpy.ssp.simulation.simulate_ssp."""

from __future__ import annotations

import time as clock
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.ssp import simulation
from fmpy.ssp.simulation import simulate_ssp

from benchmarks.engines.job import CAR_OUTPUTS, CONNECTIONS, CORNERS, DRIVEN, RECORDED, Diverged, Job, Recording
from eightpost.archive import write_archive


def run(job: Job) -> Recording:
    """Run once; only the steps are timed."""
    path = Path(job.work) / "car.ssp"
    _write(job, path)
    times = np.arange(job.count + 1) * job.step
    drive = job.drive(times)
    inputs = {name: _reader(drive[:, k].tolist(), job.rate) for k, name in enumerate(DRIVEN)}
    with job.stepping():
        try:
            rows, seconds = _timed(path, job, inputs)
        except FMICallException as error:
            raise Diverged(str(error)) from error
    values = np.array([rows[f"{component}.{name}"] for component, name in RECORDED])
    return Recording(rows["time"], values, seconds, job.count, job.rate)


def _timed(path: Path, job: Job, inputs: Any) -> tuple[Any, float]:
    """Return the rows, and the processor time from the first component's first step until the first one is freed."""
    step, free, times = simulation.do_step, simulation.free_fmu, list[float]()

    def first_step(*arguments: Any) -> None:
        simulation.do_step = step
        times.append(clock.process_time())
        step(*arguments)

    def first_freed(component: Any) -> None:
        simulation.free_fmu = free
        times.append(clock.process_time())
        free(component)

    simulation.do_step, simulation.free_fmu = first_step, first_freed
    try:
        # It adds up time and step while the sum is below the stop time: half a step less prevents an additional step.
        rows = simulate_ssp(str(path), stop_time=(job.count - 0.5) * job.step, step_size=job.step, input=inputs)
    finally:
        simulation.do_step, simulation.free_fmu = step, free
    began, ended = times
    return rows, ended - began


def _reader(values: list[float], rate: float) -> Any:
    return lambda time: values[round(time * rate)]


def _write(job: Job, path: Path) -> None:
    """Write an SSP with only the connectors that are used: simulate_ssp reads every connector after each step."""
    real = '<ssc:Real xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"/>'

    def connector(name: str, kind: str) -> str:
        return f'<ssd:Connector name="{name}" kind="{kind}">{real}</ssd:Connector>'

    def component(name: str, source: str, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> str:
        ends = [*(connector(n, "input") for n in inputs), *(connector(n, "output") for n in outputs)]
        return (
            f'<ssd:Component name="{name}" source="resources/{source}" type="application/x-fmu-sharedlibrary">'
            f"<ssd:Connectors>{''.join(ends)}</ssd:Connectors></ssd:Component>"
        )

    forces = tuple(f"{c}.force" for c in CORNERS)
    displacements = tuple(f"{c}.displacement" for c in CORNERS)
    elements = [component("car", "car.fmu", (*DRIVEN, *forces), (*CAR_OUTPUTS, *displacements))]
    elements += [component(c, "shock.fmu", ("velocity", "displacement"), ("force",)) for c in CORNERS]
    links = [
        f'<ssd:Connection startElement="{a}" startConnector="{x}" endElement="{b}" endConnector="{y}"/>'
        for (a, x), (b, y) in CONNECTIONS
    ]
    links += [f'<ssd:Connection startConnector="{n}" endElement="car" endConnector="{n}"/>' for n in DRIVEN]
    text = (
        '<?xml version="1.0" encoding="UTF-8"?><ssd:SystemStructureDescription version="1.0" name="car" '
        'xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"><ssd:System name="car"><ssd:Connectors>'
        f"{''.join(connector(n, 'input') for n in DRIVEN)}</ssd:Connectors><ssd:Elements>{''.join(elements)}"
        f"</ssd:Elements><ssd:Connections>{''.join(links)}</ssd:Connections></ssd:System>"
        "</ssd:SystemStructureDescription>"
    )
    members = {f"resources/{fmu.name}": fmu.read_bytes() for fmu in set(job.fmus.values())}
    write_archive(path, {"SystemStructure.ssd": text.encode()} | members)
