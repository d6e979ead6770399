"""Quarter car on the virtual rig with bristle friction that sticks, unlike the friction law of the identification."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import decimate

from eightpost.ident.vehicle.experiment import experiment_of
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.virtual.car import Friction
from eightpost.virtual.drivefiles import random_drive
from eightpost.virtual.program import NO_DRIFT, quarter_truth, run_test
from eightpost.virtual.shocks import LinearDamper
from eightpost.virtual.simulate import RigSensors

COULOMB = convert(15.0, "lbf", "N")
STIFFNESS = convert(4000.0, "lbf/in", "N/m")
BASELINE, ALTERNATE = (convert(rate, "lbf/(in/s)", "N.s/m") for rate in (17.5, 8.0))


def rubbing_car(coulomb, progression=0.0):
    """Return the quarter car with a bristle of a sliding force [N] and a spring of a progression [1/m]."""
    one, car = np.ones((1, 1)), quarter_truth()
    stiffness = STIFFNESS * max(coulomb / COULOMB, 1e-9)
    springs = replace(car.springs, progression=progression * one)
    return replace(car, friction=Friction(coulomb * one, 1.1 * coulomb * one, stiffness * one), springs=springs)


def rig_tests(coulomb, seed, noise=0.01, *, progression=0.0, noise_seed=0):
    """Return the tests with the baseline and the alternate damper, 60 s each, at 125 Hz."""
    car = rubbing_car(coulomb, progression)
    return [
        _at_125_hz(
            run_test(
                car,
                random_drive(car, seed + k, duration=60.0),
                (LinearDamper(damping),),
                seed=seed + k + 1000 * noise_seed,
                sensors=RigSensors.perfect(relative=noise),
                drift=NO_DRIFT,
            ).series
        )
        for k, damping in enumerate((BASELINE, ALTERNATE))
    ]


def _at_125_hz(series):
    channels = {n: (series.unit(n), decimate(series[n], 10, ftype="fir", zero_phase=True)) for n in series.names}
    count = next(iter(channels.values()))[1].size
    return TimeSeries.from_channels(series.time[::10][:count], channels)


@pytest.fixture(scope="session")
def rubbing():
    """Return the tests of a car with 15 lbf of friction."""
    return rig_tests(COULOMB, 20)


@pytest.fixture(scope="session")
def smooth():
    """Return the tests of a car without friction."""
    return rig_tests(0.0, 20)


@pytest.fixture(scope="session")
def experiment(smooth):
    """Return the experiment of the quarter car around the baseline damper."""
    return experiment_of(smooth[0].names, {"": BASELINE})
