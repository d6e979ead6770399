"""Drive file iteration on random cars and roads: the distribution of the errors after eight passes, worst first.

    python -m benchmarks.drivefile CAR.json [--runs 20] [--first 1000] [--spread 0.1] [--noise rig|none]

CAR.json is the car that `eightpost identify` found for the stand-in of docs/explanation/rig.md. The car on the rig is
another one in each run: masses, springs, tires and friction of the stand-in are changed at random, so the response that
the iteration starts with is wrong. The road, the noise and the drift of each pass are random too. The seeds from 1000
on were used for no choice in the program. "repeat" is the difference of two runs of the true lap on the rig, the level
at which passes differ by chance. All data are SYNTHETIC.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eightpost.array_types import Array
from eightpost.drivefile import Pass, Problem, Settings, Target, advance, start_response, target_names
from eightpost.drivefile.iteration import Outcome
from eightpost.drivefile.target import PassErrors, pass_errors
from eightpost.ident.vehicle import VehicleFit, read_fit
from eightpost.rig.post import NO_DRIFT, Car, RigSensors, run_test, stand_in_truth, track_drive
from eightpost.rig.post.truths import shocks_named
from eightpost.signals import Drivefile, TimeSeries

#: Shocks on the car, those of the identification.
SHOCK = "demo:A"

PASSES = 8


@dataclass(frozen=True)
class Rig:
    """A car on the virtual rig."""

    car: Car  #: Car.
    is_noisy: bool  #: Whether the sensors have noise and the rig drifts from run to run.

    def play(self, drive: Drivefile, seed: int) -> TimeSeries:
        """Return the record of a drive file."""
        sensors = RigSensors() if self.is_noisy else RigSensors.perfect()
        drift = None if self.is_noisy else NO_DRIFT
        return run_test(self.car, drive, [shocks_named((SHOCK,))[SHOCK]] * 4, seed=seed, sensors=sensors,
                        drift=drift).series  # fmt: skip


def random_car(seed: int, spread: float) -> Car:
    """Return the stand-in with masses, spring rates, tires and friction changed at random.

    Args:
        seed: Seed of the changes.
        spread: Standard deviation of the logarithm of each change [1].
    """
    car, generator = stand_in_truth(), np.random.default_rng(seed)

    def changed(values: Array) -> Array:
        return values * np.exp(spread * generator.standard_normal(values.shape))

    springs = replace(car.springs, rate=changed(car.springs.rate))
    tires = replace(car.tires, stiffness=changed(car.tires.stiffness))
    friction = replace(car.friction, coulomb=changed(car.friction.coulomb))
    friction = replace(friction, breakaway=1.15 * friction.coulomb)
    return replace(car, mass=changed(car.mass), springs=springs, tires=tires, friction=friction)


def iterate(fit: VehicleFit, rig: Rig, seed: int) -> tuple[Outcome, PassErrors]:
    """Return the state after eight passes, and the errors of a repeated lap."""
    lap = track_drive(rig.car, seed)
    names = target_names(fit.vehicle.state_space.output_names)
    track = rig.play(lap, 10 * seed).select(names)
    target = Target(track, 30.0)
    problem = Problem(target, start_response(fit.vehicle, target, measured=fit.response), Settings())
    passes: list[Pass] = []
    outcome = advance(problem, passes)
    for number in range(PASSES):
        record = rig.play(Drivefile(problem.series(outcome.drive)), 100 * seed + number).select(names)
        passes.append(Pass(outcome.drive, record.values))
        outcome = advance(problem, passes)
    return outcome, repeated(target, rig.play(lap, 10 * seed + 1).select(names))


def repeated(target: Target, again: TimeSeries) -> PassErrors:
    """Return the errors of a second run of the true lap."""
    second = Target(again, target.high)
    return pass_errors(target, second.rows + second.means[:, None])


def percents(errors: PassErrors) -> tuple[float, float]:
    """Return the errors of accelerations and displacements [%]."""
    found = [errors.of_quantity(quantity) or 0.0 for quantity in ("hub_acceleration", "displacement")]
    return 100.0 * found[0], 100.0 * found[1]


def main() -> None:
    """Print a line for each run, and the distribution."""
    options = _options()
    fit, rows = read_fit(options.car), []
    for seed in range(options.first, options.first + options.runs):
        outcome, again = iterate(fit, Rig(random_car(seed, options.spread), options.noise == "rig"), seed)
        best = percents(outcome.errors[outcome.best])
        last, repeat = percents(outcome.errors[-1]), percents(again)
        rows.append((*best, *last, *repeat))
        words = " ".join("{:.2f}/{:.2f}".format(*percents(one)) for one in outcome.errors)
        status = f"best {outcome.best + 1}, {outcome.status.value}, repeat {repeat[0]:.2f}/{repeat[1]:.2f}"
        print(f"{seed}: {words}, {status}", flush=True)
    values = np.array(rows)
    print("| error, % | worst | 90 % | median |\n|---|---|---|---|")
    heads = [
        f"{what}, {pass_}" for pass_ in ("best pass", "pass 8", "repeat") for what in ("acceleration", "displacement")
    ]
    for head, column in zip(heads, values.T, strict=True):
        print(f"| {head} | {column.max():.2f} | {np.quantile(column, 0.9):.2f} | {np.median(column):.2f} |")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("car", type=Path, help="Identified stand-in.")
    parser.add_argument("--runs", type=int, default=20, help="Number of runs.")
    parser.add_argument("--first", type=int, default=1000, help="Seed of the first run.")
    parser.add_argument("--spread", type=float, default=0.1, help="Standard deviation of the changes of the car.")
    parser.add_argument("--noise", choices=["rig", "none"], default="rig", help="Sensors and drift of the rig.")
    return parser.parse_args()


if __name__ == "__main__":
    main()
