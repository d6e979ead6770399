"""Virtual rig: a quarter-car rig and an 8-post rig with known true cars (dissertation 4.5, 6.1)."""

from eightpost.rig.post.car import Car, Friction, Geometry, RigCar, Springs, Tires
from eightpost.rig.post.drivefiles import (
    bump_drive,
    quarter_random,
    random_drive,
    sine_drive,
    static_drive,
    track_drive,
)
from eightpost.rig.post.flexible import FlexibleCar, flexible_truth
from eightpost.rig.post.program import (
    NO_DRIFT,
    PROGRAMS,
    Actuators,
    Drift,
    PlannedTest,
    bump_test,
    identification_program,
    program,
    random_test,
    run_test,
)
from eightpost.rig.post.rig_faults import MismatchedRateError, SwappedCornersError
from eightpost.rig.post.rig_test import RigConditions, RigTest, read_rig_test
from eightpost.rig.post.simulate import Motion, RigSensors, Run, simulate, simulate_setups
from eightpost.rig.post.truths import (
    TRUTHS,
    AnyCar,
    LinearDamper,
    Shock,
    quarter_truth,
    seven_dof_truth,
    stand_in_truth,
    truth_named,
)

__all__ = [
    "NO_DRIFT",
    "PROGRAMS",
    "TRUTHS",
    "Actuators",
    "AnyCar",
    "Car",
    "Drift",
    "FlexibleCar",
    "Friction",
    "Geometry",
    "LinearDamper",
    "MismatchedRateError",
    "Motion",
    "PlannedTest",
    "RigCar",
    "RigConditions",
    "RigSensors",
    "RigTest",
    "Run",
    "Shock",
    "Springs",
    "SwappedCornersError",
    "Tires",
    "bump_drive",
    "bump_test",
    "flexible_truth",
    "identification_program",
    "program",
    "quarter_random",
    "quarter_truth",
    "random_drive",
    "random_test",
    "read_rig_test",
    "run_test",
    "seven_dof_truth",
    "simulate",
    "simulate_setups",
    "sine_drive",
    "stand_in_truth",
    "static_drive",
    "track_drive",
    "truth_named",
]
