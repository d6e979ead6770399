"""Benchmark of coupling schemes: errors and stability of each, for docs/explanation/coupling.md.

    python -m benchmarks.orders

The seven-DOF car of examples/car.toml with four LPNL2 shocks fitted to examples/data/dyno_A.csv, on 10 s of
examples/data/track.parquet, with all damping in the shocks. The reference is integrated by scipy (tests/monolithic.py).
Prints Markdown and draws the page's picture.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import cosim
from benchmarks.table import ROOT, markdown, number
from builder.build import build
from eightpost.corners import CORNERS
from eightpost.errors import StepError
from eightpost.ident import fit_shock
from eightpost.rig import read_dyno_test
from eightpost.shock import Lpnl2, write_shock
from eightpost.signals import Drivefile
from eightpost.vehicle import StructuralVehicle, read_vehicle
from tests import monolithic

CAR, DATA = ROOT / "examples" / "car.toml", ROOT / "examples" / "data"
LOADS = ("heave_force", "roll_moment", "pitch_moment")

#: Time from which results are compared [s]; error from which they count as diverged [%].
SETTLING, DIVERGED = 1.0, 1000.0

#: Coupling rates [Hz], length of the runs and step of the reference's points [s].
RATES = (125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0)
STOP, RECORD_STEP = 10.0, 0.008

VALUES = ("held", "interpolated", "extrapolated", "parabolic")
SCHEMES: Mapping[str, cosim.Algorithm] = {
    **{f"Jacobi, {values}": cosim.Jacobi(values=values) for values in VALUES},
    **{f"Gauss-Seidel, {values}": cosim.GaussSeidel(values=values) for values in VALUES},
    "Implicit": cosim.Implicit(),
}

#: Colours of Okabe and Ito, one per method; line styles, one per kind of values.
COLORS = {"Jacobi": "#D55E00", "Gauss-Seidel": "#0072B2", "Implicit": "#000000"}
STYLES = {"held": "-", "interpolated": ":", "extrapolated": "--", "parabolic": "-.", "": "-"}
TITLES = ("shock velocity", "tire force")

#: Errors of shock velocity and tire force [%]; None for a diverged run.
Pair = tuple[float | None, float | None]


@dataclass(frozen=True)
class Case:
    """A drive, and the changes from the static state (4, K) in the reference solution at `time`."""

    drive: Drivefile
    time: Any
    velocity: Any
    tire_force: Any


def make_case(folder: Path, stop: float) -> Case:
    """Build car.fmu and shock.fmu in a folder, and solve the reference."""
    shock = fit_shock(read_dyno_test(DATA / "dyno_A.csv"), "lpnl2", gas="included").shock
    vehicle, law = read_vehicle(CAR), shock.law
    assert isinstance(law, Lpnl2) and isinstance(vehicle, StructuralVehicle)
    write_shock(shock, folder / "shock.json")
    build([CAR, folder / "shock.json"], folder)
    drive = Drivefile.read(DATA / "track.parquet")
    series = drive.series.window(0.0, stop)
    inputs = np.stack([series[name] for name in (*(f"{c}.road" for c in CORNERS), *LOADS)])
    time = np.arange(0.0, stop + RECORD_STEP / 2, RECORD_STEP)
    same = monolithic.Shock(
        static_force=np.vectorize(law.static_force, otypes=[float]),
        weight=np.vectorize(law.lag_weight, otypes=[float]),
        tau=law.time_constant,
        gas_stiffness=law.port.gas_stiffness,
        gas_preload=law.port.gas_preload,
    )
    found = monolithic.coupled_run(vehicle.parameters, same, series.time, inputs[:4], inputs[4:], at=time)
    return Case(drive, time, found.shock_velocity, found.tire_force)


def measure(case: Case, folder: Path, algorithm: cosim.Algorithm, step: float) -> Pair:
    """Return the errors of one run."""
    fmus = {"car": folder / "car.fmu"} | dict.fromkeys(CORNERS, folder / "shock.fmu")
    system = cosim.System.load(fmus, [cosim.Bond.between(f"car.{corner}", corner) for corner in CORNERS])
    names = [f"car.{corner}.{quantity}" for quantity in ("velocity", "tire_force") for corner in CORNERS]
    scenario = cosim.Scenario(float(case.time[-1]), case.drive, record=names)
    try:
        result = cosim.run(system, scenario, algorithm=algorithm, step=step, compared=False)
    except StepError:
        return None, None
    values = np.stack([result.series[name] for name in names])
    return (None, None) if result.partial else errors(case, result.series.time, values[:4], values[4:])


def errors(case: Case, time: Any, velocity: Any, tire_force: Any) -> Pair:
    """Return the errors at the worst corner, at the times of the reference; tire forces (4, K) are total forces."""
    static = read_vehicle(CAR).static
    after = case.time >= SETTLING - 1e-9
    at = np.searchsorted(time, case.time[after] - 1e-7)
    changes = tire_force - np.array([[static[f"{c}.tire_force"]] for c in CORNERS])
    pairs = ((velocity[:, at], case.velocity[:, after]), (changes[:, at], case.tire_force[:, after]))
    first, second = (
        float(np.max(100.0 * np.sqrt(np.mean((found - true) ** 2, axis=1)) / np.std(true, axis=1)))
        for found, true in pairs
    )
    return (first, second) if first < DIVERGED and second < DIVERGED else (None, None)


def draw(found: Mapping[str, Sequence[Pair]], path: Path) -> None:
    """Draw both quantities [%] by scheme; diverged runs are omitted."""
    figure = Figure(figsize=(12.0, 5.4), layout="constrained")
    both = figure.subplots(1, 2, sharey=True)
    for k, axes in enumerate(both):
        for scheme, pairs in found.items():
            points = [(rate, pair[k]) for rate, pair in zip(RATES, pairs, strict=True) if pair[k] is not None]
            method, _, values = scheme.partition(", ")
            axes.loglog(*zip(*points, strict=True), "o", ms=4, ls=STYLES[values], color=COLORS[method], label=scheme)
        for order, top in ((1, 70.0), (2, 0.03), (3, 0.009)):  # short lines with the slopes of the orders
            ends = (1400.0, 2800.0) if order == 1 else (140.0, 280.0)
            axes.loglog(ends, (top, top / 2.0**order), color="0.35", linewidth=1.0)
            axes.text(1.05 * ends[1], top / 2.0**order, f"order {order}", fontsize=9, color="0.35", va="center")
        title = f"{TITLES[k]}: error in % of its standard deviation"
        axes.set(title=title, xlabel="coupling rate [Hz]", ylim=(None, 500.0))
        axes.set_xticks(RATES, [f"{rate:g}" for rate in RATES])
        axes.minorticks_off()
        axes.grid(visible=True, alpha=0.3)
    figure.legend(handles=both[1].get_lines()[: len(found)], loc="outside right center")
    figure.savefig(path, dpi=120)


def _row(scheme: str, pairs: Sequence[Pair]) -> list[str]:
    """Return the cells of a scheme; the last one has the orders of both quantities between the two highest rates."""
    cells = ["diverges" if a is None or b is None else f"{number(a, 2)} / {number(b, 2)}" for a, b in pairs]
    slopes = [np.log2((a or np.nan) / (b or np.nan)) for a, b in zip(*pairs[-2:], strict=True)]
    return [scheme, *cells, " / ".join(f"{slope:.2f}" for slope in slopes)]


def main() -> None:
    """Run the measurements, draw the picture and print the table."""
    with tempfile.TemporaryDirectory() as name:
        case = make_case(Path(name), STOP)
        found = {s: [measure(case, Path(name), a, 1.0 / rate) for rate in RATES] for s, a in SCHEMES.items()}
    draw(found, ROOT / "docs" / "pictures" / "coupling.png")
    rates = [f"{rate:g} Hz" if rate < 1000.0 else f"{rate / 1000.0:g} kHz" for rate in RATES]
    print(markdown(["scheme", *rates, "order"], [_row(scheme, pairs) for scheme, pairs in found.items()]))


if __name__ == "__main__":
    main()
