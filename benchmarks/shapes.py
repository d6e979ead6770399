"""Valvings that `eightpost shapes` found, built as physical dampers and driven on a car that is known exactly.

    eightpost shapes examples/study.toml -o out/
    python -m benchmarks.shapes out/

The study runs laws; here the same car, the seven-DOF truth of the virtual rig, has the physical dampers themselves: the
best setup of the bank, and the valvings nearest to the targets. The table shows predicted and true objective. The
drive, its duration and the objective are those of the study.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cosim.study.statistics import Filtered
from cosim.study.study import Study
from eightpost import units
from eightpost.corners import CORNERS
from eightpost.rig.damper import PhysicalDamper, shim_build
from eightpost.rig.damper.valving import Valving
from eightpost.rig.post.drivefiles import RATE
from eightpost.rig.post.modes import ride_heights
from eightpost.rig.post.simulate import Run, simulate
from eightpost.rig.post.truths import seven_dof_truth
from eightpost.signals import Drivefile, TimeSeries

#: Entries of a valving in shapes.json that are parts.
_PARTS = ("compression", "rebound", "head", "clicks", "jet", "dish", "gas_pressure")


def main() -> None:
    """Print predicted and true objectives."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="output folder of eightpost shapes")
    folder = parser.parse_args().folder
    found = json.loads((folder / "shapes.json").read_text())
    study = Study.from_json(json.dumps(found["definition"]))
    bank = {corner: shim_build(name) for corner, name in found["best_of_bank"].items()}
    valvings = dict(bank)
    for target in found["targets"]:
        damper = Valving(**{name: target["valving"][name] for name in _PARTS}).damper()
        valvings |= dict.fromkeys(target["corners"], damper)
    true = [true_objective(study, shocks) for shocks in (bank, valvings)]
    predicted = [found["objective"][name] for name in ("best_of_bank", "nearest_valvings")]
    print("| objective | best of the bank | valvings | gain |\n|---|---|---|---|")
    for words, (best, better) in (("predicted", predicted), ("true", true)):
        print(f"| {words} | {best:.2f} | {better:.2f} | {best - better:.2f} ({100.0 * (best - better) / best:.2f} %) |")


def true_objective(study: Study, shocks: Mapping[str, PhysicalDamper]) -> float:
    """Return the objective of physical dampers, by corner, on the seven-DOF truth."""
    car, drive = seven_dof_truth(), study.drives[0]
    recorded = Drivefile.read(drive.file).series
    time = drive.start + np.arange(round(drive.stop * RATE) + 1) / RATE
    channels = {name: (recorded.unit(name), np.interp(time, recorded.time, recorded[name])) for name in recorded.names}
    run = Run(TimeSeries.from_channels(time, channels), tuple(shocks[corner] for corner in CORNERS))
    motion = simulate(car, [run])[0]
    roads = motion.drive[:4]
    assert car.geometry is not None
    heave, pitch = (car.points[name] @ motion.position for name in ("heave", "pitch"))
    front, rear = ride_heights(heave, pitch, roads, car.geometry)
    name = study.vehicle.name
    outputs = {f"{name}.front.ride_height": ("m", front), f"{name}.rear.ride_height": ("m", rear)}
    outputs |= {f"{name}.{c}.tire_force": ("N", row) for c, row in zip(CORNERS, motion.tire_force, strict=True)}
    series = Filtered(TimeSeries.from_channels(motion.time - motion.time[0], outputs))
    total = 0.0
    for term in study.objective:
        value = study.measure(term.measure).drawn_from(series, start=study.settling)
        own = "m" if "ride height" in term.measure else "N"
        total += term.weight * float(units.convert(value, own, term.unit or own))
    return total


if __name__ == "__main__":
    main()
