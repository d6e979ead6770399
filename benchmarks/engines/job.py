"""Request to an engine, and its recording."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eightpost.corners import CORNERS

DRIVEN = (*(f"{c}.road" for c in CORNERS), "heave_force", "roll_moment", "pitch_moment")
#: Recorded variables: ten outputs of the car and the force of each shock.
CAR_OUTPUTS = (
    *(f"{c}.velocity" for c in CORNERS), *(f"{c}.tire_force" for c in CORNERS), "front.ride_height", "rear.ride_height",
)  # fmt: skip
#: Connections (source, target), each end as `component`, `variable`.
CONNECTIONS = (
    *((("car", f"{c}.{name}"), (c, name)) for c in CORNERS for name in ("velocity", "displacement")),
    *(((c, "force"), ("car", f"{c}.force")) for c in CORNERS),
)
DRIVE_CONNECTIONS = tuple((("drive", name), ("car", name)) for name in DRIVEN)
RECORDED = (*(("car", name) for name in CAR_OUTPUTS), *((c, "force") for c in CORNERS))


class Diverged(RuntimeError):  # noqa: N818 -- an outcome of a run, not a fault of the program
    """The run ended early: a component refused a step."""


@dataclass(frozen=True)
class Job:
    """One run."""

    folder: str  #: Folder with car.fmu, shock.fmu, drive.fmu (the drive as an FMU without inputs) and drive.npz.
    scheme: str  #: One of the engine's schemes.
    rate: float  #: Coupling steps per second [Hz].
    stop: float  #: Duration [s].
    work: str  #: Folder for this run.
    repeats: int = 1  #: Number of repetitions; the minimum time counts.

    @property
    def step(self) -> float:
        """Coupling step [s]."""
        return 1.0 / self.rate

    @property
    def count(self) -> int:
        """Number of steps."""
        return round(self.stop * self.rate)

    @property
    def fmus(self) -> dict[str, Path]:
        """The FMU of each component."""
        folder = Path(self.folder)
        return {"car": folder / "car.fmu"} | dict.fromkeys(CORNERS, folder / "shock.fmu")

    def drive(self, times: Any) -> Any:
        """Return the drive (K, 7) at `times`, in the order of DRIVEN."""
        with np.load(Path(self.folder) / "drive.npz") as kept:
            return np.array([np.interp(times, kept["time"], row) for row in kept["values"]]).T

    @contextmanager
    def stepping(self) -> Iterator[None]:
        """Mark the start of stepping: if the program ends after this, the run diverged; the set-up was correct."""
        mark = Path(self.work) / "stepping"
        mark.touch()
        yield
        mark.unlink()


@dataclass(frozen=True)
class Recording:
    """Recording of an engine, and its time."""

    time: Any  #: Times (K,) [s].
    values: Any  #: Values (14, K) in the order of RECORDED, or the first eight of them.
    seconds: float  #: Measured processor time of `steps` coupling steps, without loading [s].
    steps: int  #: Number of coupling steps that were timed.
    rate: float  #: Mean rate [Hz].

    def save(self, path: Path) -> None:
        """Write the recording for the parent process."""
        np.savez(path, time=self.time, values=self.values, numbers=[self.seconds, self.steps, self.rate])

    @classmethod
    def load(cls, path: Path) -> Recording:
        """Read the recording."""
        with np.load(path) as kept:
            seconds, steps, rate = kept["numbers"]
            return cls(kept["time"], kept["values"], float(seconds), int(steps), float(rate))
