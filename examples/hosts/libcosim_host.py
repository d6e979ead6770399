"""libcosim as the host (libcosimpy): it steps all FMUs at once with held inputs, so the car is an FMU too (Jacobi).

    python examples/hosts/libcosim_host.py [--steps 8 4 2 1] [--seconds 10]

libcosim has no rollback and no input derivatives. Its remedy is a smaller step, or one FMU with car and shocks
(`eightpost build system.toml`). Outputs are recorded at the end of every step.
"""

import numpy as np
import reference
from fmpy import read_model_description
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
from reference import Case, Motion

from eightpost.corners import CORNERS
from eightpost.vehicle import read_vehicle

DRIVEN = (*(f"{corner}.road" for corner in CORNERS), "heave_force", "roll_moment", "pitch_moment")
OUTPUTS = tuple(f"{corner}.{name}" for name in ("velocity", "tire_force") for corner in CORNERS)


def references_of(path):
    """Return the value references of an FMU by name."""
    return {v.name: v.valueReference for v in read_model_description(str(path)).modelVariables}


def jacobi(case: Case) -> Motion:
    """Connect car and shocks, and set road and loads before every step."""
    log_output_level(CosimLogLevel.FATAL)
    run = CosimExecution.from_step_size(round(case.step * 1e9))
    car, shock = references_of(case.car_fmu), references_of(case.shock)
    body = run.add_local_slave(CosimLocalSlave(str(case.car_fmu), "car"))
    for corner in CORNERS:
        one = run.add_local_slave(CosimLocalSlave(str(case.shock), corner))
        run.connect_real_variables(body, car[f"{corner}.velocity"], one, shock["velocity"])
        run.connect_real_variables(body, car[f"{corner}.displacement"], one, shock["displacement"])
        run.connect_real_variables(one, shock["force"], body, car[f"{corner}.force"])
    drive, series = CosimManipulator.create_override(), CosimObserver.create_time_series(case.count + 2)
    run.add_manipulator(drive)
    run.add_observer(series)
    for name in OUTPUTS:
        series.start_time_series(body, car[name], CosimVariableType.REAL)
    inputs = [car[name] for name in DRIVEN]
    for k in range(case.count):
        drive.slave_real_values(body, inputs, reference.track()(k * case.step).tolist())
        if not run.step():
            raise ArithmeticError("libcosim: a step failed")
    found = [series.time_series_real_samples(body, car[name], 1, case.count) for name in OUTPUTS]
    rows = np.array([samples[2] for samples in found])
    static = read_vehicle(reference.CAR).static
    still = np.array([[static[f"{corner}.tire_force"]] for corner in CORNERS])
    return Motion(np.array(found[0][0]) * 1e-9, rows[:4], rows[4:] - still)


HOST = "libcosim"
LOOPS = {"J": jacobi}

if __name__ == "__main__":
    reference.main(HOST, LOOPS, package="libcosimpy")
