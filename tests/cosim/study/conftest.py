"""Small studies on the seven-DOF car."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from cosim.study import Build, Drive, Measure, Study, Vehicle
from cosim.study.running import workers
from eightpost.corners import CORNERS

TRACK = Path(__file__).resolve().parents[3] / "examples" / "data" / "track.parquet"

TIRES = tuple(f"car.{corner}.tire_force" for corner in CORNERS)
MEASURES = (
    Measure("front ride height, RMS", ("car.front.ride_height",), "rms", "in"),
    Measure("total tire force, RMS", TIRES, "rms", "lbf"),
)


@dataclass
class WorkersHere:
    """Workers that run setups in this process and record their numbers."""

    count: int = 1
    ran: list[int] = field(default_factory=list)

    def choose(self, study):
        return workers.choose(study.to_json())

    def rows(self, study, coupling, chunks: Sequence, stop: Callable[[], bool]):
        for chunk in chunks:
            if stop():
                return
            rows = workers.rows(study.to_json(), coupling, chunk.indices)
            self.ran += chunk.indices
            yield chunk, rows

    def close(self):
        pass


@pytest.fixture
def here() -> WorkersHere:
    return WorkersHere()


@pytest.fixture(scope="session")
def small_study(fmus) -> Callable[..., Study]:
    """Return a function small_study(**changes): two builds at four corners, four seconds of track."""

    def make(**changes) -> Study:
        builds = {"soft": {"compression_scale": 0.5, "rebound_scale": 0.5}, "stiff": {}}
        options = {
            "name": "two builds",
            "vehicle": Vehicle(fmus["seven_dof"]),
            "bank": {name: Build(fmus["lpnl2"], values) for name, values in builds.items()},
            "corners": dict.fromkeys(CORNERS, tuple(builds)),
            "drives": (Drive("track", TRACK, stop=4.0),),
            "measures": MEASURES,
            "settling": 1.0,
            "record_step": 4e-3,
        }
        return Study(**(options | changes))

    return make
