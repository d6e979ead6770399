"""Rigs: dynamometer tests, generators of drive files, and a virtual dynamometer."""

from eightpost.rig.damper import BUILDS, CONFIGURATIONS, PhysicalDamper, cavitation, configuration, shim_build
from eightpost.rig.dynamometer import (
    Actuator,
    Damper,
    Sensor,
    Sensors,
    SineTest,
    bump,
    measure,
    random_multisine,
    read_out,
    sine_test,
    sine_tests,
    static_steps,
)
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.dyno_test import (
    DynoTest,
    TemperatureEffect,
    read_dyno_test,
    read_dyno_tests,
    split_runs,
    temperature_effect,
)
from eightpost.rig.peak_velocity import PeakVelocityTable, read_peak_velocity
from eightpost.rig.synthetic import Track, TruthDamper, ValveSide, demo_damper, track_drivefile

__all__ = [
    "BUILDS",
    "CONFIGURATIONS",
    "Actuator",
    "Damper",
    "DynoConditions",
    "DynoTest",
    "PeakVelocityTable",
    "PhysicalDamper",
    "Sensor",
    "Sensors",
    "SineTest",
    "TemperatureEffect",
    "Track",
    "TruthDamper",
    "ValveSide",
    "bump",
    "cavitation",
    "configuration",
    "demo_damper",
    "measure",
    "random_multisine",
    "read_dyno_test",
    "read_dyno_tests",
    "read_out",
    "read_peak_velocity",
    "shim_build",
    "sine_test",
    "sine_tests",
    "split_runs",
    "static_steps",
    "temperature_effect",
    "track_drivefile",
]
