"""Simulation of one test on the virtual rig: command, actuators, car and shocks, sensors, math channels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.rig.post.actuators import Actuators
from eightpost.rig.post.channels import RigSensors, commands, sensor_channels, with_math
from eightpost.rig.post.drift import Drift
from eightpost.rig.post.drive import LEAD
from eightpost.rig.post.rig_test import RigConditions, RigTest
from eightpost.rig.post.simulate import Run, simulate
from eightpost.signals.timeseries import TimeSeries

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.rig.post.car import Car
    from eightpost.rig.post.shocks import Shock
    from eightpost.signals.drivefile import Drivefile


def run_test(
    car: Car,
    drivefile: Drivefile,
    shocks: Sequence[Shock],
    *,
    seed: int = 0,
    sensors: RigSensors | None = None,
    drift: Drift | None = None,
    actuators: Actuators | None = None,
    lead: float = LEAD,
    conditions: RigConditions | None = None,
) -> RigTest:
    """Run a test and return its record at 1250 Hz with the channels of Table 6.1.

    Args:
        car: Car to test.
        drivefile: Commands with the car's `inputs` as channels.
        shocks: One shock per corner.
        seed: Seed of noise and drift.
        sensors: Sensor noise; default that of a rig, `RigSensors.perfect()` for none.
        drift: Standard deviations of the random drift; `NO_DRIFT` for none.
        actuators: Bandwidths of the actuators.
        lead: Lead-in before the record [s]; see `simulate`.
        conditions: Conditions to write into the file; the name of the car and the seed are added.
    """
    generator, drift = np.random.default_rng(seed), drift or Drift()
    car = drift.of(car, generator)
    drive = (actuators or Actuators()).follow(drivefile.series, car)
    motion = simulate(car, [Run(drive, tuple(shocks))], lead=lead)[0]
    channels = sensor_channels(car, motion, sensors or RigSensors(), generator)
    channels = {n: (u, row + drift.zero(n, generator)) for n, (u, row) in channels.items()}
    series = TimeSeries.from_channels(motion.time, channels | commands(car, drivefile.series))
    known = RigConditions(truth=car.name, seed=seed)
    return RigTest(with_math(car, motion, series), (conditions or RigConditions()).over(known))
