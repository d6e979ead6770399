"""True systems for demonstrations and tests: a virtual dynamometer and virtual rigs with cars and dampers (4.5, 6.1).

They share no code with the models that are fitted and identified.
"""

from eightpost.virtual.builds import BUILDS as BUILDS
from eightpost.virtual.builds import CONFIGURATIONS as CONFIGURATIONS
from eightpost.virtual.builds import SHIMS_OF_BUILD as SHIMS_OF_BUILD
from eightpost.virtual.builds import configuration as configuration
from eightpost.virtual.builds import shim_build as shim_build
from eightpost.virtual.car import Car as Car
from eightpost.virtual.car import Friction as Friction
from eightpost.virtual.car import RigCar as RigCar
from eightpost.virtual.car import Springs as Springs
from eightpost.virtual.car import Tires as Tires
from eightpost.virtual.damper import PhysicalDamper as PhysicalDamper
from eightpost.virtual.drivefiles import (
    bump_drive as bump_drive,
)
from eightpost.virtual.drivefiles import (
    quarter_random as quarter_random,
)
from eightpost.virtual.drivefiles import (
    random_drive as random_drive,
)
from eightpost.virtual.drivefiles import (
    sine_drive as sine_drive,
)
from eightpost.virtual.drivefiles import (
    static_drive as static_drive,
)
from eightpost.virtual.drivefiles import (
    track_drive as track_drive,
)
from eightpost.virtual.dynamometer import (
    Actuator as Actuator,
)
from eightpost.virtual.dynamometer import (
    Damper as Damper,
)
from eightpost.virtual.dynamometer import (
    Sensor as Sensor,
)
from eightpost.virtual.dynamometer import (
    Sensors as Sensors,
)
from eightpost.virtual.dynamometer import (
    SineTest as SineTest,
)
from eightpost.virtual.dynamometer import (
    bump as bump,
)
from eightpost.virtual.dynamometer import (
    measure as measure,
)
from eightpost.virtual.dynamometer import (
    random_multisine as random_multisine,
)
from eightpost.virtual.dynamometer import (
    read_out as read_out,
)
from eightpost.virtual.dynamometer import (
    sine_test as sine_test,
)
from eightpost.virtual.dynamometer import (
    sine_tests as sine_tests,
)
from eightpost.virtual.dynamometer import (
    static_steps as static_steps,
)
from eightpost.virtual.flexible import FlexibleCar as FlexibleCar
from eightpost.virtual.flexible import flexible_truth as flexible_truth
from eightpost.virtual.program import (
    NO_DRIFT as NO_DRIFT,
)
from eightpost.virtual.program import (
    PROGRAMS as PROGRAMS,
)
from eightpost.virtual.program import (
    Actuators as Actuators,
)
from eightpost.virtual.program import (
    Drift as Drift,
)
from eightpost.virtual.program import (
    PlannedTest as PlannedTest,
)
from eightpost.virtual.program import (
    bump_test as bump_test,
)
from eightpost.virtual.program import (
    identification_program as identification_program,
)
from eightpost.virtual.program import (
    program as program,
)
from eightpost.virtual.program import (
    random_test as random_test,
)
from eightpost.virtual.program import (
    run_test as run_test,
)
from eightpost.virtual.simulate import Motion as Motion
from eightpost.virtual.simulate import RigSensors as RigSensors
from eightpost.virtual.simulate import Run as Run
from eightpost.virtual.simulate import simulate as simulate
from eightpost.virtual.simulate import simulate_setups as simulate_setups
from eightpost.virtual.synthetic import Track as Track
from eightpost.virtual.synthetic import TruthDamper as TruthDamper
from eightpost.virtual.synthetic import ValveSide as ValveSide
from eightpost.virtual.synthetic import demo_damper as demo_damper
from eightpost.virtual.synthetic import track_drivefile as track_drivefile
from eightpost.virtual.truths import (
    TRUTHS as TRUTHS,
)
from eightpost.virtual.truths import (
    AnyCar as AnyCar,
)
from eightpost.virtual.truths import (
    LinearDamper as LinearDamper,
)
from eightpost.virtual.truths import (
    Shock as Shock,
)
from eightpost.virtual.truths import (
    quarter_truth as quarter_truth,
)
from eightpost.virtual.truths import (
    seven_dof_truth as seven_dof_truth,
)
from eightpost.virtual.truths import (
    stand_in_truth as stand_in_truth,
)
from eightpost.virtual.truths import (
    truth_named as truth_named,
)
from eightpost.virtual.valves import cavitation as cavitation

__all__ = [
    "BUILDS",
    "CONFIGURATIONS",
    "NO_DRIFT",
    "PROGRAMS",
    "SHIMS_OF_BUILD",
    "TRUTHS",
    "Actuator",
    "Actuators",
    "AnyCar",
    "Car",
    "Damper",
    "Drift",
    "FlexibleCar",
    "Friction",
    "LinearDamper",
    "Motion",
    "PhysicalDamper",
    "PlannedTest",
    "RigCar",
    "RigSensors",
    "Run",
    "Sensor",
    "Sensors",
    "Shock",
    "SineTest",
    "Springs",
    "Tires",
    "Track",
    "TruthDamper",
    "ValveSide",
    "bump",
    "bump_drive",
    "bump_test",
    "cavitation",
    "configuration",
    "demo_damper",
    "flexible_truth",
    "identification_program",
    "measure",
    "program",
    "quarter_random",
    "quarter_truth",
    "random_drive",
    "random_multisine",
    "random_test",
    "read_out",
    "run_test",
    "seven_dof_truth",
    "shim_build",
    "simulate",
    "simulate_setups",
    "sine_drive",
    "sine_test",
    "sine_tests",
    "stand_in_truth",
    "static_drive",
    "static_steps",
    "track_drive",
    "track_drivefile",
    "truth_named",
]
