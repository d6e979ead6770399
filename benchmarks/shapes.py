"""Curves that `eightpost shapes` found, driven on a car that is known exactly.

    eightpost shapes examples/study.toml -o out/
    python -m benchmarks.shapes out/
    eightpost shapes examples/identified/study.toml -o out/
    python -m benchmarks.shapes out/ --car eight_post

The study runs laws on its own car. Here the true car of the virtual rig has, first, the laws of the best setup of the
bank and of the targets, which shows the errors of the car alone, and second the physical dampers themselves: the best
of the bank, and the valvings nearest to the targets. The table shows predicted and true objective. The drive, its
duration and the objective are those of the study.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.identification_measures import truth_of
from cosim.study.statistics import Filtered
from cosim.study.study import Study
from eightpost import units
from eightpost.corners import CORNERS
from eightpost.rig.damper import shim_build
from eightpost.rig.damper.builds import Valving
from eightpost.rig.post import Shock
from eightpost.rig.post.drivefiles import RATE
from eightpost.rig.post.simulate import Run, simulate
from eightpost.rig.post.truths import AnyCar, truth_named
from eightpost.shock import ShockLaw, read_shock
from eightpost.signals import Drivefile, TimeSeries

ROOT = Path(__file__).resolve().parents[1]

#: Entries of a valving in shapes.json that are parts.
_PARTS = ("compression", "rebound", "head", "clicks", "jet", "dish", "gas_pressure")


def main() -> None:
    """Print predicted and true objectives."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="output folder of eightpost shapes")
    parser.add_argument("--car", default="seven_dof", choices=("seven_dof", "eight_post"), help="true car")
    options = parser.parse_args()
    folder, car = options.folder, truth_named(options.car, None)
    found = json.loads((folder / "shapes.json").read_text())
    study = Study.from_json(json.dumps(found["definition"]))
    bank = {corner: shim_build(name) for corner, name in found["best_of_bank"].items()}
    valvings = dict(bank)
    for target in found["targets"]:
        damper = Valving(**{name: target["valving"][name] for name in _PARTS}).damper()
        valvings |= dict.fromkeys(target["corners"], damper)
    laws = {corner: _law(study, name) for corner, name in found["best_of_bank"].items()}
    targets = laws | {
        corner: read_shock(folder / "shapes" / f"{'+'.join(target['corners'])}.json").law
        for target in found["targets"]
        for corner in target["corners"]
    }
    objective = found["objective"]
    pairs = {
        "targets, predicted": (objective["best_of_bank"], objective["targets"]),
        "targets, true, laws": tuple(true_objective(car, study, shocks) for shocks in (laws, targets)),
        "valvings, predicted": (objective["best_of_bank"], objective["nearest_valvings"]),
        "valvings, true, physical dampers": tuple(true_objective(car, study, shocks) for shocks in (bank, valvings)),
    }
    print("| objective | best of the bank | found | gain |\n|---|---|---|---|")
    for words, (best, better) in pairs.items():
        print(f"| {words} | {best:.2f} | {better:.2f} | {best - better:.2f} ({100.0 * (best - better) / best:.2f} %) |")


def _law(study: Study, name: str) -> ShockLaw:
    """Return the law of a build of the bank, from the shock file that its FMU was built from."""
    return read_shock(ROOT / "examples" / "bank" / f"{Path(study.bank[name].fmu).stem}.json").law


def true_objective(car: AnyCar, study: Study, shocks: Mapping[str, Shock]) -> float:
    """Return the objective of shocks, by corner, on a true car."""
    drive = study.drives[0]
    recorded = Drivefile.read(drive.file).series
    time = drive.start + np.arange(round(drive.stop * RATE) + 1) / RATE
    channels = {name: (recorded.unit(name), np.interp(time, recorded.time, recorded[name])) for name in recorded.names}
    run = Run(TimeSeries.from_channels(time, channels), tuple(shocks[corner] for corner in CORNERS))
    motion = simulate(car, [run])[0]
    units_of = {"velocity": "m/s", "tire_force": "N", "hub_acceleration": "m/s2", "ride_height": "m"}
    outputs = {
        f"{study.vehicle.name}.{name}": (units_of[name.rpartition(".")[2]], row)
        for name, row in zip(*truth_of(car, motion), strict=True)
    }
    series = Filtered(TimeSeries.from_channels(motion.time - motion.time[0], outputs))
    total = 0.0
    for term in study.objective:
        value = study.measure(term.measure).drawn_from(series, start=study.settling)
        own = "m" if "ride height" in term.measure else "N"
        total += term.weight * float(units.convert(value, own, term.unit or own))
    return total


if __name__ == "__main__":
    main()
