"""FMPy alone as the host: its FMU2Slave in four loops, without cosim. The car is integrated by RK4 in Python.

    python examples/hosts/fmpy_host.py [--steps 8 4 2 1] [--seconds 10]

`fmpy.simulate_fmu` is no host for a vehicle: it feeds an FMU from a table. And its set_input_derivatives=True raises an
exception unless the FMU has 9 real inputs (FMPy 0.3.32). FMU2Slave has what is needed.
"""

import tempfile
from contextlib import contextmanager

import numpy as np
import reference
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave, fmi2False
from reference import Case, Motion, runge_kutta

from eightpost.corners import CORNERS

CAR = reference.car()


@contextmanager
def shocks(case: Case, inputs):
    """Yield a slave for each corner, started in equilibrium, and its value references of inputs and force."""
    with tempfile.TemporaryDirectory() as folder:
        extract(str(case.shock), folder)
        description = read_model_description(folder)
        found = {v.name: v.valueReference for v in description.modelVariables}
        ports, force = [found["velocity"], found["displacement"]], [found["force"]]
        name = description.coSimulation.modelIdentifier
        slaves = [
            FMU2Slave(guid=description.guid, unzipDirectory=folder, modelIdentifier=name, instanceName=corner)
            for corner in CORNERS
        ]
        for slave, at in zip(slaves, inputs, strict=True):
            slave.instantiate()
            slave.setupExperiment(startTime=0.0)
            slave.enterInitializationMode()
            slave.setReal(ports, at)
            slave.exitInitializationMode()
        yield slaves, ports, force
        for slave in slaves:
            slave.terminate()
            slave.freeInstance()


def ramp(slave, ports, time, h, start, end):
    """Step a slave from `time` by `h` with inputs that change linearly."""
    slave.setReal(ports, start)
    slave.setRealInputDerivatives(ports, [1, 1], (end - start) / h)
    slave.doStep(time, h, noSetFMUStatePriorToCurrentPoint=fmi2False)


def motion_at(state):
    """Return velocity and displacement of each shock (4, 2)."""
    return np.stack([CAR.S @ state[7:], CAR.S @ state[:7]], axis=1)


def slope(time, state, force):
    """Return (q', q'') of the car."""
    return np.concatenate([state[7:], CAR.acceleration(time, state[:7], state[7:], force)])


def held(case: Case, loop: str) -> Motion:
    """Hold a force over every step: J (that of the last step), A or B."""
    h, rows = case.step, [np.concatenate([CAR.equilibrium(), np.zeros(7)])]
    last = motion_at(rows[0])
    with shocks(case, last) as (slaves, ports, output):
        force = before = np.array([slave.getReal(output)[0] for slave in slaves])
        for k in range(case.count):
            now = motion_at(rows[-1])
            used = force
            if loop == "B" and k > 0:
                for slave, start, end in zip(slaves, last, now, strict=True):
                    ramp(slave, ports, (k - 1) * h, h, start, end)
            elif loop != "B":
                for slave, inputs in zip(slaves, now, strict=True):
                    slave.setReal(ports, inputs)
                    slave.doStep(k * h, h)
            before, force = force, np.array([slave.getReal(output)[0] for slave in slaves])
            used = {"J": used, "A": force, "B": 1.5 * force - 0.5 * before}[loop]
            rows.append(runge_kutta(lambda t, y, f=used: slope(t, y, f), k * h, rows[-1], h))
            last = now
    return reference.motion(CAR, np.arange(len(rows)) * h, np.array(rows))


def with_states(case: Case) -> Motion:
    """Loop C: return to the accepted state before every evaluation, and ramp the inputs to the trial point."""
    h, rows = case.step, [np.concatenate([CAR.equilibrium(), np.zeros(7)])]
    accepted = motion_at(rows[0])
    with shocks(case, accepted) as (slaves, ports, output):
        states = [slave.getFMUstate() for slave in slaves]
        at = 0.0

        def force(time, state):
            forces = []
            for slave, saved, start, end in zip(slaves, states, accepted, motion_at(state), strict=True):
                slave.setFMUstate(saved)
                if time > at:
                    ramp(slave, ports, at, time - at, start, end)
                forces.append(slave.getReal(output)[0])
            return forces

        for k in range(case.count):
            rows.append(runge_kutta(lambda t, y: slope(t, y, force(t, y)), k * h, rows[-1], h))
            force((k + 1) * h, rows[-1])
            for i, slave in enumerate(slaves):
                slave.freeFMUstate(states[i])
                states[i] = slave.getFMUstate()
            at, accepted = (k + 1) * h, motion_at(rows[-1])
        for slave, state in zip(slaves, states, strict=True):
            slave.freeFMUstate(state)
    return reference.motion(CAR, np.arange(len(rows)) * h, np.array(rows))


HOST = "FMPy, RK4"
LOOPS = {loop: lambda case, loop=loop: held(case, loop) for loop in "JAB"} | {"C": with_states}

if __name__ == "__main__":
    reference.main(HOST, LOOPS, package="fmpy")
