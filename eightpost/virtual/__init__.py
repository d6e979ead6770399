"""True systems for demonstrations and tests: a virtual dynamometer and virtual rigs with cars and dampers (4.5, 6.1).

They share no code with the models that are fitted and identified.
"""

from eightpost.virtual.car import AnyCar, Car, Friction, Springs, Tires, flexible_truth
from eightpost.virtual.damper import BUILDS, CONFIGURATIONS, SHIMS_OF_BUILD, PhysicalDamper, configuration, shim_build
from eightpost.virtual.drivefiles import (
    bump_drive,
    quarter_random,
    random_drive,
    sine_drive,
    static_drive,
    track_drive,
    track_drivefile,
)
from eightpost.virtual.dynamometer import (
    Actuator,
    bump,
    measure,
    random_multisine,
    read_out,
    sine_test,
    sine_tests,
    static_steps,
)
from eightpost.virtual.program import (
    NO_DRIFT,
    TRUTHS,
    Actuators,
    bump_test,
    identification_program,
    program,
    quarter_truth,
    run_test,
    seven_dof_truth,
    stand_in_truth,
    truth_named,
)
from eightpost.virtual.shocks import LinearDamper, Shock, demo_damper
from eightpost.virtual.simulate import Motion, RigSensors, Run, simulate, simulate_setups
from eightpost.virtual.valves import cavitation

__all__ = [
    "BUILDS", "CONFIGURATIONS", "NO_DRIFT", "SHIMS_OF_BUILD", "TRUTHS", "Actuator", "Actuators", "AnyCar", "Car",
    "Friction", "LinearDamper", "Motion", "PhysicalDamper", "RigSensors", "Run", "Shock", "Springs", "Tires", "bump",
    "bump_drive", "bump_test", "cavitation", "configuration", "demo_damper", "flexible_truth", "identification_program",
    "measure", "program", "quarter_random", "quarter_truth", "random_drive", "random_multisine", "read_out", "run_test",
    "seven_dof_truth", "shim_build", "simulate", "simulate_setups", "sine_drive", "sine_test", "sine_tests",
    "stand_in_truth", "static_drive", "static_steps", "track_drive", "track_drivefile", "truth_named",
]  # fmt: skip
