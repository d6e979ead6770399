"""Simulate an assembly in a host's loop, and its parts in the master and in a host that holds their inputs."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import cosim
from cosim import FmuComponent, GaussSeidel, Scenario
from eightpost.archive import read_archive
from eightpost.corners import CORNERS
from eightpost.signals import Drivefile, TimeSeries

ROADS = tuple(f"car.{corner}.road" for corner in CORNERS)
STOP = 1.0


def corner_file(path, car, damper):
    """Write the system file of a quarter car with a damper, and return its path."""
    parts = f'[components.corner]\nfmu = "{car.as_posix()}"\n[components.damper]\nfmu = "{damper.as_posix()}"\n'
    path.write_text(f'schema = 1\n{parts}[[bond]]\nbetween = ["corner", "damper"]\n[scenario]\nstop = 1.0\n')
    return path


def road(time):
    """Return four different roads (4, K)."""
    phases = np.arange(4)[:, None]
    slow, fast = 2.0 * np.pi * (1.1 + 0.3 * phases) * time, 2.0 * np.pi * (9.0 + 1.7 * phases) * time
    return 0.008 * np.sin(slow) + 0.002 * np.sin(fast + phases)


def grid(step):
    return np.arange(round(STOP / step) + 1) * step


def host(path, step, *, ramped=True, parameters=None, later=None, outputs=None):
    """Run an assembly in a simple host loop; return outputs (P, K+1)."""
    fmu = FmuComponent(path, "car")
    time = grid(step)
    u = road(time)
    outputs = outputs or observed(fmu)
    try:
        fmu.begin(0.0, STOP, parameters or {})
        fmu.set(ROADS, u[:, 0].tolist())
        fmu.end_initialization()
        fmu.set(list(later or ()), list((later or {}).values()))
        rows = [fmu.get(outputs)]
        for k in range(time.size - 1):
            fmu.set(ROADS, u[:, k].tolist())
            if ramped:
                fmu.set_derivatives(ROADS, ((u[:, k + 1] - u[:, k]) / step).tolist())
            fmu.step(k * step, step)
            rows.append(fmu.get(outputs))
        return np.array(rows).T
    finally:
        fmu.finish()


def replayed(path, steps):
    """Run an assembly with the inputs of its reference results; return outputs, their results, reference (K+1, P)."""
    members = read_archive(path)

    def table(kind):
        head, *lines = members[f"extra/eightpost/{Path(path).stem}_{kind}.csv"].decode().splitlines()
        return head.replace('"', "").split(","), np.array([[float(cell) for cell in line.split(",")] for line in lines])

    (names, inputs), (outputs, expected) = table("in"), table("ref")
    fmu, time = FmuComponent(path, "car"), expected[: steps + 1, 0]
    fmu.begin(0.0, time[-1], {})
    fmu.set(names[1:], inputs[0, 1:].tolist())
    fmu.end_initialization()
    found = [fmu.get(outputs[1:])]
    for row, start, end in zip(inputs[:, 1:], time, time[1:], strict=False):
        fmu.set(names[1:], row.tolist())
        fmu.step(start, end - start)
        found.append(fmu.get(outputs[1:]))
    fmu.finish()
    return outputs[1:], np.array(found), expected[: steps + 1, 1:]


def observed(fmu):
    """Return every output of the parts, without the error estimates of the assembly."""
    return [n for n, v in fmu.variables.items() if v.causality == "output" and not n.endswith("coupling_error")]


def master(case, step, *, drive_step, outputs, algorithm=None):
    """Run the separate FMUs in the master; return outputs (P, K+1) at the steps of the drive, and the result."""
    time = grid(drive_step)
    rows = dict(zip(ROADS, road(time), strict=True))
    drive = Drivefile(TimeSeries.from_channels(time, {n.removeprefix("car."): ("m", v) for n, v in rows.items()}))
    scenario = Scenario(
        stop=STOP,
        drive=drive,
        targets={n.removeprefix("car."): n for n in ROADS},
        record=tuple(outputs),
        record_step=drive_step,
    )
    free = {f"car.{n}": 0.0 for n in ("heave_force", "roll_moment", "pitch_moment")}
    system = replace(case.system, constants=free | dict(case.system.constants))
    result = cosim.run(system, scenario, algorithm=algorithm or GaussSeidel(), step=step)
    return np.array([result.series[name] for name in outputs]), result


def difference(one, other):
    """Return the largest difference of each output, relative to its largest value."""
    return np.abs(one - other).max(axis=1) / (np.abs(other).max(axis=1) + 1e-12)


def percent(rows, reference):
    """Return the RMS error of each row in percent of the reference's standard deviation, after the first 0.2 s."""
    start = rows.shape[1] // 5
    error = np.sqrt(np.mean((rows - reference)[:, start:] ** 2, axis=1))
    return 100.0 * error / reference[:, start:].std(axis=1)
