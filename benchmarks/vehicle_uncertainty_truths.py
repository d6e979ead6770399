"""True cars of the benchmark of stated uncertainties: their rig tests, the identified vehicle, and unseen setups.

Each truth is the stand-in or the flexible car with parameters drawn by a seed, its own drive file, noise and lap. Five
tests of 80 s (linear dampers of 20.74 lbf.s/in; 9 at one corner at a time), 1 % noise; a lap of 18 s with eight setups
of the seven builds of Table 7.3 and six of laws within 10 % of each other, which the model knows. The lap is smoother:
RMS values are 0.2 to 0.6 of those in the tests.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from benchmarks.identification_cases import truths_of
from benchmarks.identification_measures import QUANTITIES, SETTLING, TOTAL, measures_of
from benchmarks.identification_shocks import bank, close_bank
from cosim.study.above_band import shares_of
from eightpost.errors import StepError
from eightpost.ident.preparation import Preparation, prepare
from eightpost.ident.vehicle.experiment import Experiment, experiment_of, find_baseline
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.recipes.common_poles import CommonPoles
from eightpost.rig import BUILDS
from eightpost.rig.post import (
    NO_DRIFT,
    Actuators,
    AnyCar,
    Car,
    LinearDamper,
    RigSensors,
    RigTest,
    flexible_truth,
    random_drive,
    run_test,
    stand_in_truth,
    track_drive,
)
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]

Kind = Literal["stand-in", "flexible"]
KINDS: tuple[Kind, ...] = get_args(Kind)

#: Seeds of the reported results.
REPORT = tuple(range(1000, 1010))

#: Durations of a rig test and of the lap [s]; relative noise of every channel [1]; dampers of the tests [N.s/m].
TEST, LAP, NOISE = 80.0, 18.0, 0.01
BASELINE, ALTERNATE = convert(20.74, "lbf.s/in", "N.s/m"), convert(9.0, "lbf.s/in", "N.s/m")

#: Numbers of setups from the builds of Table 7.3 and from similar laws.
WIDE, CLOSE = 8, 6

#: Outputs are kept at every fifth sample of 1250 Hz.
_EVERY, _RATE = 5, 1250.0


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Identification of one truth."""

    kind: Kind  #: Kind of the true car.
    seed: int  #: Seed of its parameters, drive, noise, lap and setups.
    records: tuple[TimeSeries, ...]  #: Prepared records of the tests.
    experiment: Experiment  #: Experiment of the identification.
    fit: VehicleFit  #: Identified vehicle.
    #: Bank indices (S, 4) of the shocks; the builds of Table 7.3, then similar laws.
    setups: tuple[tuple[int, ...], ...]
    true: list[dict[str, float]]  #: True measures of each setup.
    predicted: list[dict[str, float]]  #: Predicted measures of each setup; empty if a setup cannot be simulated.
    shares: dict[str, Array]  #: Shares of the predicted power in the bands, of the first setup, by measure.

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the measures."""
        return tuple(self.true[0])

    @property
    def similar(self) -> int:
        """Index of the first setup of similar laws."""
        return next(k for k, setup in enumerate(self.setups) if min(setup) >= len(BUILDS))

    def errors(self) -> Array:
        """Return ln(predicted / true) (setups, measures)."""
        return self.logarithms(self.predicted) - self.logarithms(self.true)

    def logarithms(self, rows: Sequence[Mapping[str, float]]) -> Array:
        """Return the logarithms of measures (setups, measures)."""
        return np.asarray(np.log([[row[name] for name in self.names] for row in rows]))


def outcome(kind: Kind, seed: int, folder: Path | None = None) -> Outcome:
    """Identify a truth, or read it from a folder where it was kept."""
    kept = None if folder is None else folder / f"{kind}_{seed}.pickle"
    if kept is not None and kept.exists():
        found: Outcome = pickle.loads(kept.read_bytes())
        return found
    made = _identified(kind, seed)
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_bytes(pickle.dumps(made))
    return made


def _identified(kind: Kind, seed: int) -> Outcome:
    car, laws = truth(kind, seed), (*bank(), *close_bank())
    prepared = prepare(rig_tests(car, seed), Preparation())
    baseline = find_baseline(prepared.records, prepared.corners, test=0)
    experiment = experiment_of(prepared.channels, baseline.damping, name=f"{kind}_{seed}")
    experiment = replace(experiment, means=prepared.means[0])
    experiment = experiment.of(*[n for n in experiment.outputs if n.endswith((*QUANTITIES, "displacement"))])
    fit = CommonPoles().identify(prepared.records, experiment)
    lap = Actuators().follow(track_drive(car, 40000 + seed, duration=LAP).series, car)
    setups = draw_setups(seed, len(bank()), len(close_bank()))
    true = list(truths_of(car, lap, [tuple(laws[i] for i in setup) for setup in setups]))
    predicted, shares = predictions(fit, lap, setups)
    return Outcome(kind, seed, prepared.records, experiment, fit, setups, true, predicted, shares)


def predictions(
    fit: VehicleFit, lap: TimeSeries, setups: Sequence[Sequence[int]]
) -> tuple[list[dict[str, float]], dict[str, Array]]:
    """Return the predicted measures of setups, and the shares of the first setup's power in the bands.

    Both are empty if a setup cannot be simulated.
    """
    names, rate = fit.vehicle.state_space.output_names, _RATE / _EVERY
    try:
        outputs = ManySetups(fit.vehicle, (*bank(), *close_bank()), lap, _EVERY).run(setups)
    except StepError:
        return [], {}
    measures = [measures_of(names, y, rate) for y in outputs]
    rows = dict(zip(names, outputs[0][:, round(SETTLING * rate) :], strict=True))
    rows[TOTAL] = np.sum([row for name, row in rows.items() if name.endswith("tire_force")], axis=0)
    return measures, {name: shares_of(rows[name][None], rate) for name in measures[0]}


def truth(kind: Kind, seed: int) -> AnyCar:
    """Return a true car with parameters drawn by a seed."""
    return flexible_truth(seed) if kind == "flexible" else _stand_in(seed)


def _stand_in(seed: int) -> Car:
    """Return the stand-in with parameters that vary as much as those of `flexible_truth`."""
    car, generator = stand_in_truth(), np.random.default_rng([7, seed])

    def factors(count: int, deviation: float) -> Array:
        return np.asarray(np.exp(deviation * np.clip(generator.standard_normal(count), -2.0, 2.0)))

    def corners(deviation: float, sides: float = 0.02) -> Array:
        return (np.repeat(factors(2, deviation), 2) * factors(4, sides))[:, None]

    springs, tires, friction = car.springs, car.tires, car.friction
    mass = car.mass * np.concatenate([factors(4, 0.06), np.repeat(factors(1, 0.08), 2), factors(2, 0.08)])
    force, stiffness = corners(0.3, 0.1), corners(0.12)
    return replace(
        car,
        mass=mass,
        stiffness=car.stiffness * factors(1, 0.15),
        springs=replace(springs, rate=springs.rate * stiffness, progression=springs.progression * corners(0.4)),
        tires=replace(tires, stiffness=tires.stiffness * corners(0.08), damping=tires.damping * corners(0.25)),
        friction=replace(
            friction,
            coulomb=friction.coulomb * force,
            breakaway=friction.breakaway * force,
            stiffness=friction.stiffness * factors(1, 0.3),
        ),
    )


def rig_tests(car: AnyCar, seed: int) -> Iterator[RigTest]:
    """Yield the rig tests of a true car: the baseline, then another damper at each corner."""
    drive, sensors = random_drive(car, 20000 + seed, duration=TEST), RigSensors.perfect(relative=NOISE)
    for number in range(5):
        shocks = [LinearDamper(ALTERNATE if place == number - 1 else BASELINE) for place in range(4)]
        yield run_test(car, drive, shocks, seed=30000 + 10 * seed + number, sensors=sensors, drift=NO_DRIFT)


def draw_setups(seed: int, builds: int, similar: int) -> tuple[tuple[int, ...], ...]:
    """Return the bank indices of unseen setups: of the builds, then of similar laws."""
    generator = np.random.default_rng([9, seed])
    wide = generator.integers(0, builds, (WIDE, 4))
    close = generator.integers(builds, builds + similar, (CLOSE, 4))
    return tuple(tuple(int(i) for i in row) for row in np.vstack([wide, close]))
