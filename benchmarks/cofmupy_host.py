"""Car and four shocks coupled by CoFMUPy, compared with the assembled FMU (docs/evidence/hosts_tools.md).

    python benchmarks/cofmupy_host.py FOLDER [STEP]

The folder contains car.fmu, shock.fmu and whole.fmu, their assembly (`eightpost build --assemble`). CoFMUPy 1.0.0 needs
an environment of its own with FMPy 0.3.20. Prints the error of the worst corner in percent of the standard deviation.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

CORNERS = ("lf", "rf", "lr", "rr")
OUTPUTS = tuple(f"{c}.{name}" for name in ("velocity", "tire_force") for c in CORNERS)
STOP = 2.0  # s


def road(time: float) -> dict[str, float]:
    """Return the road heights [m]: two sines, later at each corner, zero at the start."""
    delayed = {c: (time - 0.05 * k, -0.05 * k) for k, c in enumerate(CORNERS)}
    return {f"{c}.road": _height(now) - _height(then) for c, (now, then) in delayed.items()}


def _height(time: float) -> float:
    return 0.004 * math.sin(2 * math.pi * 1.5 * time) + 0.001 * math.sin(2 * math.pi * 12 * time)


def assembled(path: Path, step: float) -> Any:
    """Return the outputs (steps, 8) of the assembled FMU for the same held roads."""
    folder = fmpy.extract(str(path))
    description = fmpy.read_model_description(folder)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    identifier = description.coSimulation.modelIdentifier
    slave = FMU2Slave(guid=description.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName="whole")
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    rows = []
    for k in range(round(STOP / step)):
        given = road(k * step)
        slave.setReal([reference[f"car.{name}"] for name in given], list(given.values()))
        slave.doStep(k * step, step)
        rows.append(slave.getReal([reference[f"car.{name}"] for name in OUTPUTS]))
    return np.array(rows)


def coupled(folder: Path, step: float, method: str) -> Any:
    """Return the outputs (steps, 8) of the car that CoFMUPy couples with its shocks."""
    from cofmupy.master.default_master import DefaultMaster  # noqa: PLC0415

    files = {"car": "car.fmu"} | dict.fromkeys(CORNERS, "shock.fmu")
    units = [{"id": n, "name": n, "path": str(folder / file), "initialization": {}} for n, file in files.items()]
    links = {("car", f"{c}.{name}"): [(c, name)] for c in CORNERS for name in ("velocity", "displacement")}
    links |= {(c, "force"): [("car", f"{c}.force")] for c in CORNERS}
    master = DefaultMaster(units, links, [tuple(files)], cosim_method=method)
    master.init_simulation(input_dict={})
    rows = []
    for k in range(round(STOP / step)):
        given = {name: [value] for name, value in road(k * step).items()}
        found = master.do_step(step, {"car": given}, record_outputs=False)["car"]
        rows.append([float(np.ravel(found[name])[0]) for name in OUTPUTS])
    return np.array(rows)


def main() -> None:
    """Print the errors of both methods."""
    folder, step = Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 1e-3
    true = assembled(folder / "whole.fmu", step)
    for method in ("jacobi", "gauss_seidel"):
        change = coupled(folder, step, method)
        change = change - change[0] - (true - true[0])
        error = 100 * np.sqrt(np.mean(change**2, axis=0)) / true.std(axis=0)
        print(f"{method}: shock velocity {error[:4].max():.3g} %, tire force {error[4:].max():.3g} %")


if __name__ == "__main__":
    main()
