"""The standard case of the benchmarks: a car, four shocks, a drive file, and a monolithic reference solution.

The model is the seven-DOF car of examples/car.toml with four LPNL2 shocks fitted to examples/data/dyno_A.csv, on the
first part of examples/data/track.parquet, with all damping in the shocks. The reference is integrated by scipy
(tests/monolithic.py).
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.table import ROOT
from builder.build import build
from eightpost.corners import CORNERS
from eightpost.shock import Lpnl2, Shock, ShockLaw, write_shock
from eightpost.signals import Drivefile
from eightpost.vehicle import StructuralVehicle, read_vehicle

LOADS = ("heave_force", "roll_moment", "pitch_moment")
SETTLING = 1.0
#: Results with a larger error count as diverged [%].
DIVERGED = 1000.0


@cache
def monolithic() -> ModuleType:
    """Load the independent reference solver of the tests."""
    spec = importlib.util.spec_from_file_location("monolithic", ROOT / "tests" / "monolithic.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Case:
    """A car, one shock law for all corners, a drive file, and the reference solution at `time`.

    `velocity` and `tire_force` (4, K) are changes from the static state.
    """

    law: Lpnl2
    drive: Drivefile
    stop: float
    time: Any
    velocity: Any
    tire_force: Any


def make_case(law: Lpnl2, drive: Drivefile, stop: float, *, record_step: float = 0.004) -> Case:
    """Solve the reference at the recorded times, with shocks of a `law`."""
    series = drive.series.window(0.0, stop)
    inputs = np.stack([series[name] for name in (*(f"{c}.road" for c in CORNERS), *LOADS)])
    time = np.arange(0.0, stop + record_step / 2, record_step)
    reference = monolithic()
    vehicle = read_vehicle(ROOT / "examples" / "car.toml")
    assert isinstance(vehicle, StructuralVehicle)
    shock = reference.Shock(
        static_force=np.vectorize(law.static_force, otypes=[float]),
        weight=np.vectorize(law.lag_weight, otypes=[float]),
        tau=law.time_constant,
        gas_stiffness=law.port.gas_stiffness,
        gas_preload=law.port.gas_preload,
    )
    found = reference.coupled_run(vehicle.parameters, shock, series.time, inputs[:4], inputs[4:], at=time)
    return Case(law, drive, stop, time, found.shock_velocity, found.tire_force)


def build_fmus(law: ShockLaw, folder: Path) -> None:
    """Build car.fmu and shock.fmu."""
    folder.mkdir(parents=True, exist_ok=True)
    write_shock(Shock("shock", law), folder / "shock.json")
    build([ROOT / "examples" / "car.toml", folder / "shock.json"], folder)


@cache
def fitted_law() -> Lpnl2:
    """Fit the first record of the demo."""
    from eightpost.ident import fit_shock  # noqa: PLC0415
    from eightpost.rig import read_dyno_test  # noqa: PLC0415

    fit = fit_shock(read_dyno_test(ROOT / "examples" / "data" / "dyno_A.csv"), "lpnl2", gas="included")
    assert isinstance(fit.shock.law, Lpnl2)
    return fit.shock.law


def track() -> Drivefile:
    """Read the drive file of the demo: 30 s."""
    return Drivefile.read(ROOT / "examples" / "data" / "track.parquet")


def errors(case: Case, time: Any, velocity: Any, tire_force: Any) -> tuple[float | None, float | None]:
    """Return the errors of shock velocity and tire force [%] at the worst corner, at the times of the reference.

    Tire forces (4, K) are total forces: the car's static forces are subtracted. Returns None for a diverged run.
    """
    static = read_vehicle(ROOT / "examples" / "car.toml").static
    at = np.clip(np.searchsorted(time, case.time - 1e-7), 0, len(time) - 1)
    there = (np.abs(np.asarray(time)[at] - case.time) < 1e-6) & (case.time >= SETTLING - 1e-9)
    if there.sum() < 2 or not (np.isfinite(velocity).all() and np.isfinite(tire_force).all()):
        return None, None
    changes = tire_force - np.array([[static[f"{c}.tire_force"]] for c in CORNERS])
    pairs = ((velocity, case.velocity), (changes, case.tire_force))
    first, second = (_worst(found[:, at[there]], true[:, there]) for found, true in pairs)
    return (first, second) if max(first, second) < DIVERGED else (None, None)


def _worst(found: Any, true: Any) -> float:
    return float(np.max(100.0 * rms(found - true) / np.std(true, axis=1)))


def rms(values: Any) -> Any:
    """Return the root mean square over time."""
    return np.sqrt(np.mean(values**2, axis=1))
