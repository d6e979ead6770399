"""What limits the prediction of a rig day: the same comparison with the true car in place of the identified one.

    python -m benchmarks.rig_day FOLDER

FOLDER is that of docs/make/make_rig_day.py. The measured levels of its 21 setups are compared with the prediction, with
the true car without drift and noise and the fitted laws of the shocks, and with the true car and the true dampers. What
the last one misses is drift from run to run, which no prediction can know.
"""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np

from benchmarks.identification_measures import measures_of, truth_of
from eightpost.corners import CORNERS
from eightpost.rig import shim_build
from eightpost.rig.post import Actuators, Shock, simulate_setups, track_drive, truth_named
from eightpost.rig.post.drivefiles import RATE
from eightpost.shock.file import read_shock

#: Seed of the lap in docs/make/make_rig_day.py, and the time that its study leaves out [s].
LAP, SETTLING = 77, 2.0

MEASURES = {
    "total tire force, RMS": "total_tire_force",
    "front ride height, RMS": "front.ride_height",
    "rear ride height, RMS": "rear.ride_height",
    "lf tire force, RMS": "lf.tire_force",
    "rr tire force, RMS": "rr.tire_force",
    "rf hub acceleration, RMS": "rf.hub_acceleration",
    "lr hub acceleration, RMS": "lr.hub_acceleration",
    "lf shock velocity, RMS": "lf.velocity",
    "rr shock velocity, RMS": "rr.velocity",
}


def main(folder: Path) -> None:
    """Print the table for a rig day."""
    compared = json.loads((folder / "study" / "compared" / "comparison.json").read_text(encoding="utf-8"))["measures"]
    found = {entry["measure"]: entry for entry in compared if entry["measure"] in MEASURES}
    with (folder / "study" / "selection.csv").open(encoding="utf-8", newline="") as stream:
        builds = {int(row["setup"]): [row[corner] for corner in CORNERS] for row in csv.DictReader(stream)}
    setups = [builds[number] for number in next(iter(found.values()))["setups"]]
    car = truth_named("eight_post", None)
    lap = Actuators().follow(track_drive(car, LAP, duration=33.0).series, car)
    laws = {b: read_shock(folder / "bank" / f"{b.replace('/', '_')}.json").law for s in setups for b in s}

    def levels_of(shocks: list[tuple[Shock, ...]]) -> list[dict[str, float]]:
        motions = simulate_setups(car, lap, shocks)
        return [measures_of(*truth_of(car, motion), RATE, settling=SETTLING) for motion in motions]

    exact = levels_of([tuple(shim_build(build) for build in setup) for setup in setups])
    fitted = levels_of([tuple(laws[build] for build in setup) for setup in setups])
    print("| RMS | a run's sigma [%] | prediction | true car, fitted laws | true car, true dampers |")
    print("|---|---|---|---|---|")
    for measure, entry in found.items():
        levels = [entry["predicted"], *([row[MEASURES[measure]] for row in rows] for rows in (fitted, exact))]
        cells = [_cell(np.array(one), entry) for one in levels]
        sigma = 100.0 * entry["run_to_run"] / float(np.mean(entry["measured"]))
        print(f"| {measure.removesuffix(', RMS')} | {sigma:.2g} | {' | '.join(cells)} |")


def _cell(levels: np.ndarray, entry: dict[str, list[float]]) -> str:
    """Return setups in the band about the best-fit line, scatter about it, and level error."""
    measured = np.array(entry["measured"])
    slope, intercept = np.polyfit(levels, measured, 1)
    off = measured - intercept - slope * levels
    inside = int((np.abs(off) <= entry["band"]).sum())
    scatter = 100.0 * off.std(ddof=2) / measured.mean()
    return f"{inside} of {off.size}, {scatter:.2f} %, {100.0 * np.sqrt(np.mean((levels / measured - 1.0) ** 2)):.2f} %"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
