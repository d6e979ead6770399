"""The engine of this project: cosim.run, in this process."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from pathlib import Path
from unittest.mock import patch

import numpy as np

import cosim
from benchmarks.engines.job import CORNERS, RECORDED, Diverged, Recording
from eightpost.errors import StepError
from eightpost.signals import Drivefile

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
