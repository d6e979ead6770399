"""Run mixed laws, friction and a filter in lanes of a library with sanitizers; a finding ends this process."""

import sys
from pathlib import Path

import numpy as np

from cosim.study import Measure, Vehicle
from cosim.study.machine import library
from cosim.study.running.batches import Batches
from cosim.study.running.evaluator import Evaluator
from eightpost.corners import CORNERS

from .batched import COUPLING, LAWS, random_builds, random_setups, study_of


def main() -> None:
    """Run a study of the FMUs in the folder that is the argument."""
    fmus = {path.stem: path for path in Path(sys.argv[1]).glob("*.fmu")}
    library._FLAGS = ("-std=gnu11", "-O1", "-g", "-w", "-shared", "-fPIC", "-fvisibility=hidden", *sys.argv[2:])
    values = {"friction_force": 40.0, "bristle_force": 60.0, "bristle_static_ratio": 1.2, "port_spring": 1e5}
    measures = [Measure("band", ("car.front.ride_height",), band=(1.0, 5.0))]
    measures += [Measure(name, ("car.lf.tire_force",), name) for name in ("rms", "peak", "mean")]
    for parameters in ({}, {f"{corner}.{n}": v for corner in CORNERS for n, v in values.items()}):
        vehicle = Vehicle(fmus["seven_dof"], parameters=parameters)
        study = study_of(fmus, random_builds(fmus, LAWS, 10, seed=5), vehicle, measures=tuple(measures))
        batches = Batches(Evaluator(study), COUPLING.scheme, COUPLING.step)
        found = [runs["track"].values for _, runs, _ in batches.runs(random_setups(study, 11)) if runs]
        assert len(found) == 11 and all(np.isfinite(list(values.values())).all() for values in found)
    print("no finding")


if __name__ == "__main__":
    main()
