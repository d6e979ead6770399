"""Accuracy and cost of the coupling: every scheme and step against the monolithic solution.

    python benchmarks/coupling.py [--quick] [--json FILE]

The seven-DOF car of examples/car.toml with four LPNL2 shocks fitted to examples/data/dyno_A.csv (all damping is in
the shocks) on the start of examples/data/track.parquet. The reference integrates the same equations as one system
with scipy (tests/monolithic.py). Prints a Markdown table; --json leaves rows {engine, scheme, damping, rate_hz,
us_per_step, error_velocity_percent, error_tire_force_percent}, percent of the reference signal's standard deviation.
Times are of this machine and this run: compare them within one table only.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import cosim
from builder.build import build
from eightpost.errors import StepError
from eightpost.shock import Lpnl2, Shock, write_shock
from eightpost.signals import Drivefile
from eightpost.vehicle import read_vehicle

ROOT = Path(__file__).resolve().parents[1]
CORNERS = ("lf", "rf", "lr", "rr")
LOADS = ("heave_force", "roll_moment", "pitch_moment")
SETTLING = 1.0


def monolithic() -> ModuleType:
    """Load the independent reference that the tests use."""
    spec = importlib.util.spec_from_file_location("monolithic", ROOT / "tests" / "monolithic.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Case:
    """A car, one law on all corners, a drive; the reference's answers at `time`."""

    law: Lpnl2
    drive: Drivefile
    stop: float
    time: Any
    velocity: Any
    tire_force: Any


def make_case(law: Lpnl2, drive: Drivefile, stop: float, *, record_step: float = 0.004) -> Case:
    """Solve the reference at the recorded times."""
    reference = monolithic()
    car = read_vehicle(ROOT / "examples" / "car.toml").parameters
    curve = np.vectorize(law.static_force, otypes=[float])
    shock = reference.Shock(
        static_force=curve,
        weight=np.vectorize(law.lag_weight, otypes=[float]),
        tau=law.time_constant,
        gas_stiffness=law.port.gas_stiffness,
        gas_preload=law.port.gas_preload,
    )
    series = drive.series.window(0.0, stop)
    road = np.stack([series[f"{c}.road"] for c in CORNERS])
    loads = np.stack([series[name] for name in LOADS])
    time = np.arange(0.0, stop + record_step / 2, record_step)
    found = reference.coupled_run(car, shock, series.time, road, loads, at=time)
    return Case(law, drive, stop, time, found.shock_velocity, found.tire_force)


def load_system(folder: Path) -> cosim.System:
    """Load the coupled car from the FMUs in `folder`."""
    fmus = {"car": folder / "car.fmu"} | dict.fromkeys(CORNERS, folder / "shock.fmu")
    return cosim.System.load(fmus, [cosim.Bond.between(f"car.{corner}", corner) for corner in CORNERS])


def build_fmus(law: Lpnl2, folder: Path) -> None:
    """Build car.fmu and shock.fmu."""
    write_shock(Shock("shock", law), folder / "shock.json")
    build([ROOT / "examples" / "car.toml", folder / "shock.json"], folder)


def measure(case: Case, folder: Path, algorithm: cosim.Algorithm, step: float) -> dict[str, Any]:
    """Run once; return a row of the table. A scheme that diverges has errors of infinity."""
    channels = tuple(f"car.{c}.{name}" for name in ("velocity", "tire_force") for c in CORNERS)
    scenario = cosim.Scenario(case.stop, case.drive, record=channels, record_step=float(case.time[1]))
    row = {"engine": "eightpost", "scheme": algorithm.name, "damping": "full", "rate_hz": 1.0 / step}
    try:
        result = cosim.run(load_system(folder), scenario, algorithm=algorithm, step=step)
    except StepError:
        return row | {"us_per_step": None, "error_velocity_percent": None, "error_tire_force_percent": None}
    static = np.array([[result.series[f"car.{c}.tire_force"][0]] for c in CORNERS]) - case.tire_force[:, :1]
    settled = case.time >= SETTLING

    def error(name: str, reference: Any, offset: Any = 0.0) -> float:
        found = np.stack([result.series[f"car.{c}.{name}"] for c in CORNERS]) - offset
        return float(np.max(100 * rms((found - reference)[:, settled]) / np.std(reference[:, settled], axis=1)))

    return row | {
        "us_per_step": 1e6 * result.seconds / result.steps,
        "error_velocity_percent": error("velocity", case.velocity),
        "error_tire_force_percent": error("tire_force", case.tire_force, static),
    }


def rms(values: Any) -> Any:
    """Return the root mean square along time."""
    return np.sqrt(np.mean(values**2, axis=1))


def fitted_law() -> Lpnl2:
    """Fit the demo's first record."""
    from eightpost.ident import fit_shock  # noqa: PLC0415
    from eightpost.rig import read_dyno_test  # noqa: PLC0415

    fit = fit_shock(read_dyno_test(ROOT / "examples" / "data" / "dyno_A.csv"), "lpnl2", gas="included")
    assert isinstance(fit.shock.law, Lpnl2)
    return fit.shock.law


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the rows as a table; errors are of the worst corner."""
    lines = [
        "| scheme | step [ms] | shock velocity [%] | tire force [%] | us per step |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        numbers = [row["error_velocity_percent"], row["error_tire_force_percent"], row["us_per_step"]]
        cells = "diverges | diverges | -" if None in numbers else " | ".join(f"{n:.3g}" for n in numbers)
        lines.append(f"| {row['scheme']} | {1e3 / row['rate_hz']:g} | {cells} |")
    return "\n".join(lines)


def main() -> None:
    """Run the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="5 s instead of 10 s of the track")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    options = parser.parse_args()
    drive = Drivefile.read(ROOT / "examples" / "data" / "track.parquet")
    case = make_case(fitted_law(), drive, 5.0 if options.quick else 10.0, record_step=0.008)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build_fmus(case.law, folder)
        rows = [
            measure(case, folder, algorithm, step)
            for algorithm in cosim.ALGORITHMS.values()
            for step in (0.008, 0.004, 0.002, 0.001, 0.0005, 0.00025)
        ]
    print(markdown(rows))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
