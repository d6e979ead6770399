"""Rig tests and identified cars, which replace the records of chapters 5 and 6."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from dissertation.true_cars import channels_of
from eightpost.array_types import Array
from eightpost.ident.preparation import Preparation, prepare
from eightpost.ident.vehicle.boggs import Boggs
from eightpost.ident.vehicle.experiment import Experiment, experiment_of, find_baseline
from eightpost.ident.vehicle.simulation import ManySetups
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.rig import RigTest
from eightpost.shock import Polylinear, ShockLaw, StaticCurve
from eightpost.shock.curve import INNER_ORDER
from eightpost.signals import Drivefile, TimeSeries
from eightpost.units import si_factor
from eightpost.vehicle import CORNERS
from eightpost.virtual import (
    NO_DRIFT,
    Actuators,
    AnyCar,
    LinearDamper,
    RigSensors,
    random_drive,
    run_test,
    simulate_setups,
    track_drive,
    truth_named,
)
from eightpost.virtual import Shock as TrueShock
from eightpost.virtual.drivefiles import RATE

#: Seeds of drive, noise and lap.
_DRIVE, _NOISE, _LAP = 11, 1100, 77

#: Interval of the identified car's output samples, in samples of 1250 Hz.
EVERY = 5
RATE_OF_MODEL = RATE / EVERY

#: Channels that are identified and compared.
_QUANTITIES = ("velocity", "tire_force", "hub_acceleration", "ride_height", "displacement")

_DAMPING = si_factor("lbf/(in/s)")

#: Velocity up to which a linear law has polynomials instead of straight ends [m/s]; the force is the same.
_SPEED = 1.0


@dataclass(frozen=True, slots=True)
class Rig:
    """A car on a virtual rig."""

    truth: str  #: Name of the true car.
    noise: float  #: Noise relative to each channel's standard deviation [1].
    baseline: float  #: Damping of the baseline shocks [lbf/(in/s)].
    alternate: float  #: Damping of the alternate shock [lbf/(in/s)].

    @property
    def car(self) -> AnyCar:
        """True car."""
        return truth_named(self.truth)

    @property
    def dampers(self) -> tuple[LinearDamper, LinearDamper]:
        """Baseline and alternate shock."""
        return LinearDamper(self.baseline * _DAMPING), LinearDamper(self.alternate * _DAMPING)


#: 5.1.3: the car of Table 5.1 with shocks of 20 and 8 lb/(in/s). 6.3.1: 20.74 and 9 lb/(in/s).
SEVEN_DOF = Rig("seven_dof", 0.02, 20.0, 8.0)
EIGHT_POST = Rig("eight_post", 0.01, 20.74, 9.0)

#: Setups of 5.3.4 and 6.1.5: the baseline shocks, then the alternate shock at each corner.
FIVE_SETUPS = ((0, 0, 0, 0), *(tuple(int(corner == k) for corner in range(4)) for k in range(4)))
FIVE_NAMES = ("baseline", *CORNERS)


def tests(rig: Rig, seconds: float) -> Iterator[RigTest]:
    """Yield the rig tests: baseline, then the alternate shock at each corner, all on one drive (6.1.5)."""
    car, shocks = rig.car, rig.dampers
    drive = random_drive(car, _DRIVE, duration=seconds)
    sensors = RigSensors.perfect(relative=rig.noise)
    for number, setup in enumerate(FIVE_SETUPS):
        chosen = [shocks[k] for k in setup]
        yield run_test(car, drive, chosen, seed=_NOISE + number, sensors=sensors, drift=NO_DRIFT)


@cache
def records_of(rig: Rig, seconds: float) -> tuple[tuple[TimeSeries, ...], Experiment]:
    """Return the records at 125 Hz, the baseline first, and their experiment."""
    prepared = prepare(tests(rig, seconds), Preparation())
    found = find_baseline(prepared.records, prepared.corners, test=0)
    experiment = experiment_of(prepared.channels, found.damping, name=rig.truth)
    return prepared.records, experiment.of(*(name for name in experiment.outputs if name.endswith(_QUANTITIES)))


@cache
def identified(rig: Rig, seconds: float) -> VehicleFit:
    """Return the car identified with the dissertation's method."""
    records, experiment = records_of(rig, seconds)
    return Boggs().identify(records, experiment)


@cache
def lap_of(rig: Rig, seconds: float) -> TimeSeries:
    """Return the motion of the actuators on a lap at 1250 Hz."""
    return follow(rig.car, track_drive(rig.car, _LAP, duration=seconds))


def follow(car: AnyCar, drive: Drivefile) -> TimeSeries:
    """Return the motion of the actuators on a drive at 1250 Hz."""
    return Actuators().follow(drive.series, car)


Channels = Mapping[str, Array]


def true_channels(rig: Rig, drive: TimeSeries, setups: Sequence[Sequence[TrueShock]]) -> tuple[Channels, ...]:
    """Return the channels (N,) of the true car with setups, at 1250 Hz and without noise."""
    car = rig.car
    motions = simulate_setups(car, drive, [tuple(shocks) for shocks in setups])
    return tuple({name: row for name, (_, row) in channels_of(car, motion).items()} for motion in motions)


def identified_channels(
    fit: VehicleFit,
    drive: TimeSeries,
    bank: Sequence[ShockLaw],
    setups: Sequence[Sequence[int]],
    every: int = EVERY,
) -> tuple[Channels, ...]:
    """Return the channels of the identified car with setups; each `every`-th sample of the drive."""
    names = fit.vehicle.state_space.output_names
    found = ManySetups(fit.vehicle, bank, drive, every).run(setups)
    return tuple(dict(zip(names, outputs, strict=True)) for outputs in found)


def linear_law(damping: float) -> ShockLaw:
    """Return the law of a linear damper [N.s/m]."""
    rate = damping * _SPEED
    inner = (rate, *[0.0] * (INNER_ORDER - 1))
    compression, rebound = (rate, rate, 0.0, 0.0), (-rate, -rate, 0.0, 0.0)
    return Polylinear(StaticCurve(inner, compression, rebound, _SPEED, 0.1, _SPEED, _SPEED, damping, damping))


def about_mean(values: Array) -> Array:
    """Return a signal without its mean."""
    return np.asarray(values - values.mean())
