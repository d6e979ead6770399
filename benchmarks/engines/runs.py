"""Request of a run, its recording, and the engine of this project: cosim.run."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import cosim
from benchmarks.case import Case, errors
from eightpost.corners import CORNERS
from eightpost.errors import StepError
from eightpost.signals import Drivefile

DRIVEN = (*(f"{c}.road" for c in CORNERS), "heave_force", "roll_moment", "pitch_moment")
#: Recorded variables: ten outputs of the car and the force of each shock.
CAR_OUTPUTS = (
    *(f"{c}.velocity" for c in CORNERS), *(f"{c}.tire_force" for c in CORNERS), "front.ride_height", "rear.ride_height",
)  # fmt: skip
RECORDED = (*(("car", name) for name in CAR_OUTPUTS), *((c, "force") for c in CORNERS))


class Diverged(RuntimeError):  # noqa: N818 -- an outcome of a run, not a fault of the program
    """The run ended early: a component refused a step."""


@dataclass(frozen=True)
class Job:
    """One run."""

    folder: Path  #: Folder with car.fmu and shock.fmu.
    track: Drivefile  #: Drive of the car.
    scheme: str  #: One of the engine's schemes.
    rate: float  #: Coupling steps per second [Hz].
    stop: float  #: Duration [s].
    work: Path  #: Folder for this run.

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
        return {"car": self.folder / "car.fmu"} | dict.fromkeys(CORNERS, self.folder / "shock.fmu")

    def drive(self, times: Any) -> Any:
        """Return the drive (K, 7) at `times`, in the order of DRIVEN."""
        series = self.track.series
        return np.array([np.interp(times, series.time, series[name]) for name in DRIVEN]).T


@dataclass(frozen=True)
class Recording:
    """Recording of an engine, and its time."""

    time: Any  #: Times (K,) [s].
    values: Any  #: Values (14, K) in the order of RECORDED, or the first eight of them.
    seconds: float  #: Measured processor time of `steps` coupling steps, without loading [s].
    steps: int  #: Number of coupling steps that were timed.
    rate: float  #: Mean rate [Hz].


ENGINE = "eightpost"
NOTE = (
    "cosim.run with numba. In every scheme the drive is a ramp over each step, which the other engines hold but for "
    "the C loop and fmpy's with derivatives: `held` speaks of coupling values alone; every step is recorded, but every "
    "8 ms under `adaptive`, whose cost is of a half step; processor time of the steps alone; for `default` that of the "
    "steps of all its runs, over the steps of the last"
)
_VALUES = ("held", "extrapolated", "parabolic")
#: Schemes at a given rate.
FIXED: Mapping[str, cosim.Algorithm] = {
    **{f"jacobi, {v}": cosim.Jacobi(values=v) for v in _VALUES},
    **{f"gauss-seidel, {v}": cosim.GaussSeidel(values=v) for v in ("interpolated", *_VALUES)},
    "implicit": cosim.Implicit(),
}
#: Tolerances of the adaptive scheme, which controls its own steps.
ADAPTIVE: Mapping[str, cosim.Adaptive] = {
    f"adaptive, {tolerance:g}": cosim.Adaptive(relative=tolerance) for tolerance in (1e-2, 1e-3, 1e-4, 1e-5)
}
#: Duration of repeated runs [s], about as long as a slower engine takes; at most MOST repetitions.
AS_LONG, MOST = 0.3, 40
#: Time between recorded samples if steps vary [s].
RECORD_STEP = 0.008

Row = dict[str, Any]
NAMES = tuple(f"{component}.{name}" for component, name in RECORDED)


def load(folder: Path) -> cosim.System:
    """Load the coupled car."""
    fmus = {"car": folder / "car.fmu"} | dict.fromkeys(CORNERS, folder / "shock.fmu")
    return cosim.System.load(fmus, [cosim.Bond.between(f"car.{corner}", corner) for corner in CORNERS])


def run_fixed(
    system: cosim.System, drive: Drivefile, stop: float, algorithm: cosim.Algorithm, rate: float, *, repeats: int = 3
) -> Recording:
    """Run at one rate, every step recorded."""
    scenario = cosim.Scenario(stop, drive, record=NAMES)
    return _best(lambda: cosim.run(system, scenario, algorithm=algorithm, step=1.0 / rate, compared=False), repeats)


def run_adaptive(
    system: cosim.System, drive: Drivefile, stop: float, algorithm: cosim.Adaptive, *, repeats: int = 3
) -> Recording:
    """Run with adaptive steps; recorded times cost steps, so only as many are recorded as are compared."""
    scenario = cosim.Scenario(stop, drive, record=NAMES, record_step=RECORD_STEP)
    return _best(
        lambda: cosim.run(system, scenario, algorithm=algorithm, step=RECORD_STEP / 8, compared=False), repeats
    )


def run_default(system: cosim.System, drive: Drivefile, stop: float, *, repeats: int = 3) -> Recording:
    """Run as a user does with the default settings; the time is that of the steps of all its runs."""
    scenario = cosim.Scenario(stop, drive, record=NAMES)
    return _best(lambda: cosim.run(system, scenario), repeats)


def _best(run: Callable[[], cosim.Result], repeats: int) -> Recording:
    """Run `repeats` times and return the fastest; with several repeats, run for about as long as slower engines."""
    with patch.object(clock, "perf_counter", clock.process_time):  # the loop then measures processor time
        return _least(run, repeats)


def _least(run: Callable[[], cosim.Result], repeats: int) -> Recording:
    try:
        results = [run()]
        if repeats > 1:
            as_long = int(repeats * AS_LONG / max(results[0].stepping_seconds, 1e-6))
            results += [run() for _ in range(min(max(repeats, as_long), MOST) - 1)]
    except StepError as error:
        raise Diverged(str(error)) from error
    result = results[-1]
    if result.partial:
        raise Diverged(result.notes[-1])
    return _recording(result, min(r.stepping_seconds for r in results), result.steps)


def _recording(result: cosim.Result, seconds: float, steps: int) -> Recording:
    values = np.stack([result.series[name] for name in NAMES])
    stop = float(result.series.time[-1])
    return Recording(result.series.time, values, seconds, steps, result.steps / stop)


def attempt(run: Callable[[], Recording]) -> Recording | Diverged:
    """Run, and return the exception if the run diverges."""
    try:
        return run()
    except Diverged as reason:
        return reason


def row(case: Case, label: tuple[str, str, str, float | None], found: Recording | Diverged) -> Row:
    """Return a row with errors and cost, which are empty for a diverged run."""
    named = dict(zip(("engine", "scheme", "damping", "rate_hz"), label, strict=True))
    if isinstance(found, Diverged):
        print(f"{', '.join(map(str, label))} Hz: {found}", file=sys.stderr)
        return named | dict.fromkeys(("us_per_step", "error_velocity_percent", "error_tire_force_percent"))
    velocity, tire_force = errors(case, found.time, found.values[:4], found.values[4:8])
    is_measured = velocity is not None and found.seconds > 0.0 and found.steps > 0
    return named | {
        "rate_hz": found.rate,
        "us_per_step": 1e6 * found.seconds / found.steps if is_measured else None,
        "error_velocity_percent": velocity,
        "error_tire_force_percent": tire_force,
    }


def measure(case: Case, folder: Path, algorithm: cosim.Algorithm, step: float) -> Row:
    """Run eightpost's engine once; return a row of the table. Errors are None if the run diverged."""

    def once() -> Recording:
        return run_fixed(load(folder), case.drive, case.stop, algorithm, 1.0 / step, repeats=1)

    damping = "split" if case.port_damping else "full"
    return row(case, (ENGINE, algorithm.name, damping, 1.0 / step), attempt(once))
