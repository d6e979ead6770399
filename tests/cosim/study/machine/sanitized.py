"""Run mixed laws, friction, coupled states and a filter in lanes with sanitizers; a finding ends this process."""

import sys
from pathlib import Path

import numpy as np

from cosim.study import Measure, Vehicle
from cosim.study.running.batches import Batches
from cosim.study.running.evaluator import Evaluator
from eightpost.corners import CORNERS
from eightpost.machine import car

from .lanes import LAWS, random_builds, random_setups, study_of


def main() -> None:
    """Run studies of the FMUs in the folder that is the first argument, and of the car that is the second."""
    fmus = {path.stem: path for path in Path(sys.argv[1]).glob("*.fmu")}
    car._FLAGS = ("-std=gnu11", "-O1", "-g", "-w", "-shared", "-fPIC", "-fvisibility=hidden", *sys.argv[3:])
    values = {"friction_force": 40.0, "bristle_force": 60.0, "bristle_static_ratio": 1.2, "port_spring": 1e5}
    measures = [Measure("band", ("car.front.ride_height",), band=(1.0, 5.0))]
    measures += [Measure(name, ("car.lf.tire_force",), name) for name in ("rms", "peak", "mean")]
    rubbing = {f"{corner}.{n}": v for corner in CORNERS for n, v in values.items()}
    for vehicle in (Vehicle(Path(sys.argv[2])), Vehicle(fmus["seven_dof"], parameters=rubbing)):
        study = study_of(fmus, random_builds(fmus, LAWS, 10, seed=5), vehicle, measures=tuple(measures))
        for single in (False, True):
            batches = Batches(Evaluator(study), 1e-3, single=single)
            found = [runs["track"].values for _, runs, _ in batches.runs(random_setups(study, 11)) if runs]
            assert len(found) == 11 and all(np.isfinite(list(values.values())).all() for values in found)
    print("no finding")


if __name__ == "__main__":
    main()
