"""Records of dynamometers and rigs: files of any layout, read, checked and in ports of SI units."""

from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.dyno_test import (
    DynoTest,
    TemperatureEffect,
    dyno_test_of,
    read_dyno_test,
    read_dyno_tests,
    split_runs,
    temperature_effect,
)
from eightpost.rig.geometry import Geometry
from eightpost.rig.peak_velocity import PeakVelocityTable, read_peak_velocity
from eightpost.rig.rig_test import MismatchedRateError, RigConditions, RigTest, SwappedCornersError, read_rig_test

__all__ = [
    "DynoConditions", "DynoTest", "Geometry", "MismatchedRateError", "PeakVelocityTable", "RigConditions",
    "RigTest", "SwappedCornersError", "TemperatureEffect", "dyno_test_of", "read_dyno_test", "read_dyno_tests",
    "read_peak_velocity", "read_rig_test", "split_runs", "temperature_effect",
]  # fmt: skip
