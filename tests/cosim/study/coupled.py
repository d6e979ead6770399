"""A study of real FMUs: the seven-DOF car on a few seconds of the track, one shock FMU with scaled forces."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cosim.study.definition import Build, Drive, Study, Term, Vehicle
from cosim.study.measures import Measure
from cosim.study.running.evaluator import Coupling

from .conftest import TRACK, WorkersHere
from .constructed import CORNERS

#: Compression and rebound scales of the shock's static force, by build.
SCALES = {"soft": (0.5, 0.5), "bump": (1.6, 0.7), "middle": (1.0, 1.0), "rebound": (0.7, 1.6), "stiff": (2.0, 2.0)}

#: Fixed coupling that is accurate enough for tests that do not choose one.
COUPLING = Coupling("gauss-seidel", 1e-3, stated_error=0.1)


def study(fmus: Mapping[str, Path]) -> Study:
    """Return a study of 25 setups: the front corners have the same build, and so have the rear ones."""
    names = ("compression_scale", "rebound_scale")
    bank = {build: Build(fmus["lpnl2"], dict(zip(names, pair, strict=True))) for build, pair in SCALES.items()}
    tires = tuple(f"car.{corner}.tire_force" for corner in CORNERS)
    measures = (
        Measure("total tire force", tires, display="lbf"),
        Measure("front ride height", ("car.front.ride_height",), display="in"),
    )
    return Study(
        name="coupled",
        vehicle=Vehicle(fmus["seven_dof"]),
        bank=bank,
        corners=dict.fromkeys(CORNERS, tuple(SCALES)),
        drives=(Drive("track", TRACK, 3.0),),
        measures=measures,
        objective=(Term("total tire force", 1.0, "lbf"),),
        baseline=dict.fromkeys(CORNERS, "middle"),
        alike=(("lf", "rf"), ("lr", "rr")),
        settling=0.5,
    )


class InProcess(WorkersHere):
    """Workers that run setups in this process with the fixed coupling."""

    def choose(self, _study: Study) -> Coupling:
        return COUPLING
