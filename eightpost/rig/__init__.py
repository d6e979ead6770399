"""Rigs: dynamometer tests, drivefile generators, a virtual dynamometer."""

from eightpost.rig.dynamometer import Sensor, Sensors, measure
from eightpost.rig.dyno_test import DynoConditions, DynoTest, read_dyno_test
from eightpost.rig.multisine import random_multisine
from eightpost.rig.track import Track, track_drivefile
from eightpost.rig.truth_damper import TruthDamper, ValveSide, demo_damper

__all__ = [
    "DynoConditions",
    "DynoTest",
    "Sensor",
    "Sensors",
    "Track",
    "TruthDamper",
    "ValveSide",
    "demo_damper",
    "measure",
    "random_multisine",
    "read_dyno_test",
    "track_drivefile",
]
