"""Ablation study of the stand-in: misfit and predictions of the identification if nonlinear parts are removed from it.

    python benchmarks/identification_ablation.py [--duration 800] [--setups 40] [--only NAMES] [--json FILE]

Each row is eight_post_known of benchmarks/identification.py with parts of the true car made linear, identified with
friction at the ports and without: RMS and largest error over all measures and setups, rank correlations, the misfit in
standard deviations of the estimate (the largest of a quantity's outputs), and the estimated friction over the true one.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np

from benchmarks.identification import markdown
from benchmarks.identification_cases import CASES, Case, records_of, truths
from benchmarks.identification_measures import QUANTITIES, agreement, measures_of
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.recipes.common_poles import CommonPoles, Identification
from eightpost.rig.post import Car

Row = dict[str, Any]
Change = Callable[[Car], Car]

#: Outputs are kept at every fifth sample of 1250 Hz, and this number of setups is simulated at once.
_EVERY, _TOGETHER = 5, 20


def _smooth(car: Car) -> Car:
    return car.without_friction()


def _straight(car: Car) -> Car:
    """Return the car with linear springs."""
    return replace(car, springs=replace(car.springs, progression=np.zeros_like(car.springs.progression)))


def _free(car: Car) -> Car:
    """Return the car without bump stops."""
    return replace(car, springs=replace(car.springs, stop_gap=np.full_like(car.springs.stop_gap, np.inf)))


def _glued(car: Car) -> Car:
    """Return the car with tires that do not lift off."""
    return replace(car, tires=replace(car.tires, static_load=np.full_like(car.tires.static_load, np.inf)))


#: Descriptions of the removed parts, and functions that remove them.
ABLATIONS: dict[str, tuple[Change, ...]] = {
    "nothing": (),
    "friction": (_smooth,),
    "progressive springs": (_straight,),
    "lift-off": (_glued,),
    "bump stops": (_free,),
    "all but friction": (_straight, _glued, _free),
    "all": (_smooth, _straight, _glued, _free),
}


def main() -> None:
    """Run the ablations."""
    options = _options()
    rows: list[Row] = []
    for name in options.only.split(";") if options.only else ABLATIONS:
        for row in ablation(name, options.duration, options.setups):
            print(json.dumps(row), file=sys.stderr, flush=True)
            rows.append(row)
    print(markdown(rows))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def ablation(name: str, duration: float, most: int) -> list[Row]:
    """Return a row with friction at the model's ports and one without."""
    case = replace(CASES["eight_post_known"], duration=duration, changes=ABLATIONS[name])
    lap, setups = case.lap(), case.chosen(most)
    true = list(truths(case, lap, setups))
    tests = records_of(case)
    rows = []
    plain = CommonPoles(springs=None, samples=0)
    for model, recipe in (("friction", plain), ("none", replace(plain, friction=None))):
        found = recipe.explain(*tests)
        row: Row = {"left out": name, "at the ports": model, "setups": len(setups)}
        row |= agreement(true, _predicted(case, found, lap, setups))._asdict()
        rows.append(row | _misfits(found) | _forces(case, found))
    return rows


def _predicted(case: Case, found: Identification, lap: Any, setups: Sequence[Sequence[int]]) -> list[dict[str, float]]:
    vehicle = found.vehicle_fit.vehicle
    simulation, names = ManySetups(vehicle, case.laws(), lap, _EVERY), vehicle.state_space.output_names
    predicted = []
    for k in range(0, len(setups), _TOGETHER):
        measured = simulation.run(setups[k : k + _TOGETHER])
        predicted += [measures_of(names, y, lap.sample_rate / _EVERY) for y in measured]
    return predicted


def _misfits(found: Identification) -> Row:
    excess = found.model_fit.excess
    return {f"{q}, deviations": max(v for n, v in excess.items() if n.endswith(q)) for q in QUANTITIES}


def _forces(case: Case, found: Identification) -> Row:
    if found.friction is None:
        return {}
    car = case.car
    assert isinstance(car, Car)
    true = dict(zip(car.corners, car.friction.coulomb[:, 0], strict=True))
    shares = [100.0 * force / true[port] for port, force in found.friction.force.items() if true[port] > 1.0]
    return {"force, % of true": ", ".join(f"{share:.1f}" for share in shares) or "none"}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=800.0, help="duration of each rig test [s]")
    parser.add_argument("--setups", type=int, default=40, help="number of setups, chosen at random")
    parser.add_argument("--only", default="", help=f"ablations to run, separated by semicolons: {', '.join(ABLATIONS)}")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
