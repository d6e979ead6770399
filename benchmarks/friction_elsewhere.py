"""What friction that identified vehicles lack costs them: at the anti-roll bars, and in the tires.

    python -m benchmarks.friction_elsewhere [--seeds 1005 1000]

Vehicles have friction that sticks at the shock ports only. The flexible car also has it at both anti-roll bars and, as
dry hysteresis, in the tires. Each row removes one of them from the true car, makes its rig tests, identifies it by
common-poles and compares fourteen unseen setups (benchmarks/vehicle_uncertainty_truths.py): the difference to the first
row is the most that a model of this friction can gain.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.identification_cases import truths_of
from benchmarks.identification_measures import QUANTITIES, agreement
from benchmarks.identification_shocks import bank, close_bank
from benchmarks.vehicle_uncertainty_truths import LAP, NOISE, draw_setups, predictions, rig_tests
from eightpost.ident.preparation import Preparation, prepare
from eightpost.ident.vehicle.experiment import experiment_of, find_baseline
from eightpost.ident.vehicle.recipes.common_poles import CommonPoles
from eightpost.rig.post import Actuators, flexible_truth, track_drive
from eightpost.rig.post.flexible import FlexibleCar
from eightpost.rig.post.flexible.car import Sliders

#: Remaining share of a removed friction [1]; the true car needs some.
NEARLY_NOTHING = 1e-3


def without_bar_friction(car: FlexibleCar) -> FlexibleCar:
    """Return the car with a thousandth of the friction at its anti-roll bars, the last two of its sliders."""
    sizes = np.array([1.0, 1.0, 1.0, 1.0, NEARLY_NOTHING, NEARLY_NOTHING])
    friction = car.friction
    return replace(
        car,
        friction=Sliders(friction.sliding * sizes, friction.breakaway * sizes, friction.stiffness * sizes),
    )


def without_hysteresis(car: FlexibleCar) -> FlexibleCar:
    """Return the car with a thousandth of the hysteresis in its tires."""
    return replace(car, tires=replace(car.tires, hysteresis=car.tires.hysteresis.scaled(NEARLY_NOTHING)))


CARS: dict[str, Callable[[FlexibleCar], FlexibleCar]] = {
    "as it is": lambda car: car,
    "no friction at the bars": without_bar_friction,
    "no hysteresis in the tires": without_hysteresis,
}


def row(seed: int, name: str) -> str:
    """Return the errors of one car as a row of a table."""
    car, laws = CARS[name](flexible_truth(seed)), (*bank(), *close_bank())
    prepared = prepare(rig_tests(car, seed), Preparation())
    baseline = find_baseline(prepared.records, prepared.corners, test=0)
    experiment = replace(experiment_of(prepared.channels, baseline.damping, name="car"), means=prepared.means[0])
    experiment = experiment.of(*[n for n in experiment.outputs if n.endswith((*QUANTITIES, "displacement"))])
    fit = CommonPoles(samples=0, levels=None).identify(prepared.records, experiment)
    lap = Actuators().follow(track_drive(car, 40000 + seed, duration=LAP).series, car)
    setups = draw_setups(seed, len(bank()), len(close_bank()))
    true = list(truths_of(car, lap, [tuple(laws[i] for i in setup) for setup in setups]))
    found, _ = predictions(fit, lap, setups)
    if not found:
        return f"| {seed} | {name} | no prediction | | | |"
    figures = agreement(true, found)
    return (
        f"| {seed} | {name} | {figures.all_percent:.2f} | {figures.max_percent:.2f} | {figures.spearman_min:.3f} | "
        f"{fit.ranges['frequency'][1]:.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1005, 1000], help="seeds of the flexible car")
    parser.add_argument("--cars", nargs="+", choices=tuple(CARS), default=list(CARS), help="rows of the table")
    given = parser.parse_args()
    print(f"| seed | car (noise {100.0 * NOISE:g} %) | all % | max % | lowest Spearman | band to Hz |")
    print("|---|---|---|---|---|---|")
    for seed in given.seeds:
        for name in given.cars:
            print(row(seed, name), flush=True)


if __name__ == "__main__":
    main()
