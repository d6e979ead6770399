"""The cases of the identification benchmark: a true car, its rig tests, a drive file, setups with true measures.

Noise is white, proportional to each measured channel's standard deviation, at the rig's 1250 Hz; there is no drift. The
true cars are simulated at 5 kHz with code that shares nothing with the identified models (docs/explanation/rig.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.identification_measures import QUANTITIES, measures_of, truth_of
from benchmarks.identification_shocks import bank, close_bank, fitted_bank, physical_bank, twelve
from eightpost.ident.preparation import Preparation, prepare
from eightpost.ident.vehicle.experiment import Experiment, experiment_of, find_baseline
from eightpost.rig import shim_build
from eightpost.rig.dynamometer import random_multisine
from eightpost.rig.post import (
    NO_DRIFT,
    Actuators,
    AnyCar,
    Car,
    LinearDamper,
    RigSensors,
    RigTest,
    Shock,
    random_drive,
    run_test,
    simulate_setups,
    track_drive,
    truth_named,
)
from eightpost.rig.post.drivefiles import RATE, STEPS
from eightpost.signals import Drivefile, TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.shock import ShockLaw

    Array = NDArray[np.float64]

_DAMPING = convert(1.0, "lbf.s/in", "N.s/m")
_INCH, _POUND = convert(1.0, "in", "m"), convert(1.0, "lbf", "N")

#: Seeds of the reported results; settings were chosen with other seeds.
DRIVE, NOISE, LAP, CHOICE = 11, 1100, 77, 5


@dataclass(frozen=True, slots=True)
class Case:
    """A case of the identification benchmark."""

    name: str  #: Name of the case.
    truth: str  #: Name of the true car.
    duration: float  #: Duration of each rig test [s].
    noise: float  #: Noise relative to each channel's standard deviation [1].
    setups: int  #: Number of setups in a full run; --quick uses at most 100.
    baseline: Callable[[], Shock]  #: Shock of the baseline test.
    alternate: Callable[[], Shock]  #: Shock that replaces the baseline shock at one corner at a time.
    shocks: Callable[[], Sequence[Shock]]  #: Bank of shocks for the true car.
    laws: Callable[[], Sequence[ShockLaw]]  #: Bank of shock laws for the identified vehicle.
    #: Functions that modify the true car, applied in order; for cars with matrices only.
    changes: tuple[Callable[[Car], Car], ...] = ()
    car_seed: int | None = None  #: Seed of the parameters of the flexible car; None gives its base parameters.
    #: Number of integration steps per sample of the true car; physical dampers on the flexible car need 8.
    steps: int = STEPS

    @property
    def car(self) -> AnyCar:
        """Return the true car."""
        car = truth_named(self.truth, self.car_seed)
        for change in self.changes:
            assert isinstance(car, Car)
            car = change(car)
        return car

    def tests(self, noise: int = NOISE) -> Iterator[RigTest]:
        """Yield the rig tests: baseline, then the alternate shock at each corner; noise seeds start at `noise`."""
        car, drive = self.car, self._identification_drive()
        baseline, alternate = self.baseline(), self.alternate()
        for number in range(len(car.corners) + 1):
            shocks = [alternate if place == number - 1 else baseline for place in range(len(car.corners))]
            sensors = RigSensors.perfect(relative=self.noise)
            seed = noise + number
            yield run_test(car, drive, shocks, seed=seed, sensors=sensors, drift=NO_DRIFT, steps=self.steps)

    def _identification_drive(self) -> Drivefile:
        return random_drive(self.car, DRIVE, duration=self.duration)

    def lap(self) -> TimeSeries:
        """Return the motion of the actuators for which setups are compared."""
        car = self.car
        command = _quarter_lap() if self.truth == "quarter_car" else track_drive(car, LAP, duration=33.0).series
        return Actuators().follow(command, car)

    def chosen(self, most: int | None) -> list[tuple[int, ...]]:
        """Return setups: all combinations, or a random subset of them."""
        corners, count = len(self.car.corners), len(self.laws())
        every = np.array(np.unravel_index(np.arange(count**corners), (count,) * corners)).T
        wanted = min(self.setups, most or self.setups, len(every))
        if wanted < len(every):
            every = every[np.sort(np.random.default_rng(CHOICE).choice(len(every), wanted, replace=False))]
        return [tuple(int(i) for i in row) for row in every]


def noise_seeds(count: int) -> tuple[int, ...]:
    """Return the first noise seed of each of `count` sets of rig tests; no two tests share one."""
    return tuple(NOISE + 10 * k for k in range(count))


def records_of(case: Case, noise: int = NOISE) -> tuple[tuple[TimeSeries, ...], Experiment]:
    """Return records at 125 Hz with noise seeds from `noise`, baseline first, and their experiment."""
    prepared = prepare(case.tests(noise), Preparation())
    found = find_baseline(prepared.records, prepared.corners, test=0)
    experiment = experiment_of(prepared.channels, found.damping, name=case.name)
    names = [n for n in experiment.outputs if n.endswith((*QUANTITIES, "displacement"))]
    return prepared.records, experiment.of(*names)


def truths(case: Case, lap: TimeSeries, setups: Sequence[Sequence[int]]) -> Iterator[dict[str, float]]:
    """Yield the true measures of setups."""
    shocks = case.shocks()
    yield from truths_of(case.car, lap, [tuple(shocks[i] for i in setup) for setup in setups], steps=case.steps)


def truths_of(
    car: AnyCar, lap: TimeSeries, setups: Sequence[tuple[Shock, ...]], *, steps: int = STEPS
) -> Iterator[dict[str, float]]:
    """Yield the measures of a true car with shocks at its corners."""
    for motion in simulate_setups(car, lap, setups, steps=steps):
        names, values = truth_of(car, motion)
        yield measures_of(names, values, RATE)


def _quarter_lap() -> TimeSeries:
    """Return the drive file of 4.4.2: 1 in, and 100 lbf about 500 lbf; spectra of Fig 4.13 as in Tables 3.2 and 6.3."""
    road = random_multisine(LAP, duration=33.0).series.resample(RATE)
    time = np.arange(round(33.0 * RATE) + 1) / RATE
    generator = np.random.default_rng(LAP)
    lines = np.arange(1, 50) / 10.0
    phases = generator.uniform(0.0, 2.0 * np.pi, lines.size)
    sizes = np.interp(lines, (0.0, 3.0, 4.0, 5.0), (1.0, 1.0, 0.1, 0.01))
    load = np.sum(sizes[:, None] * np.cos(2.0 * np.pi * lines[:, None] * time + phases[:, None]), axis=0)
    load *= 100.0 * _POUND / np.abs(load).max()
    values = np.interp(time, road.time, road[road.names[0]])
    grown = np.minimum(time, 1.0)
    return TimeSeries.from_channels(time, {"road": ("m", grown * values), "aero_force": ("N", grown * load)})


def _linear(rate: float) -> Callable[[], Shock]:
    return lambda: LinearDamper(rate * _DAMPING)


def _seven(name: str, duration: float) -> Case:
    return Case(name, "seven_dof", duration, 0.02, 2401, _linear(20.0), _linear(8.0), bank, bank)


#: 4.4, 5.3 and 6.3, on the virtual rig.
CASES = {
    case.name: case
    for case in (
        Case("quarter_car", "quarter_car", 100.0, 0.02, 12, _linear(17.5), lambda: twelve()[0], twelve, twelve),
        _seven("seven_dof_800s", 800.0),
        _seven("seven_dof_100s", 100.0),
        Case("eight_post_known", "eight_post", 800.0, 0.01, 2401, _linear(20.74), _linear(9.0), bank, bank),
        Case(
            "eight_post_fitted", "eight_post", 800.0, 0.01, 2401,
            lambda: shim_build("B/B"), lambda: shim_build("F/F"), physical_bank, fitted_bank,
        ),
        Case(
            "eight_post_dampers", "eight_post", 800.0, 0.01, 2401,
            _linear(20.74), _linear(9.0), physical_bank, fitted_bank,
        ),
        Case("eight_post_close", "eight_post", 800.0, 0.01, 2401, _linear(20.74), _linear(9.0), close_bank, close_bank),
        Case("flexible_known", "flexible", 800.0, 0.01, 2401, _linear(20.74), _linear(9.0), bank, bank),
        Case(
            "flexible_fitted", "flexible", 800.0, 0.01, 2401,
            lambda: shim_build("B/B"), lambda: shim_build("F/F"), physical_bank, fitted_bank, steps=8,
        ),
        Case(
            "flexible_dampers", "flexible", 800.0, 0.01, 2401,
            _linear(20.74), _linear(9.0), physical_bank, fitted_bank, steps=8,
        ),
        Case("flexible_close", "flexible", 800.0, 0.01, 2401, _linear(20.74), _linear(9.0), close_bank, close_bank),
    )
}  # fmt: skip
