"""Benchmark of a plain host: parallel steps with held inputs, outputs read after the step (docs/how_to/import.md).

    python benchmarks/plain_host.py [--picture FILE]

Most importing tools exchange values this way. The loop below is such a host; it shares only the loading of FMUs with
cosim's master. The car, the shocks, the drive file and the monolithic reference are those of benchmarks/case.py, on
10 s of the track. Errors are those of the worst corner in percent of the reference signal's standard deviation, without
the first second. Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import cosim
from benchmarks import case as cases
from benchmarks.rows import measure
from cosim import FmuComponent
from eightpost.errors import StepError
from eightpost.signals import Drivefile

RATES = (125, 250, 500, 1000, 2000, 4000)  # Hz
OUTPUTS = tuple(f"{c}.{name}" for name in ("velocity", "displacement", "tire_force") for c in cases.CORNERS)
PORT = ("velocity", "displacement")


def plain_host(folder: Path, drive: Drivefile, stop: float, step: float) -> Any:
    """Return car outputs (12, K+1) at every step: velocities, displacements and tire forces in the order of OUTPUTS."""
    car = FmuComponent(folder / "car.fmu", "car")
    shocks = {corner: FmuComponent(folder / "shock.fmu", corner) for corner in cases.CORNERS}
    forces = tuple(f"{corner}.force" for corner in cases.CORNERS)
    driven = tuple(name for name in drive.series.names if name in car.variables)
    count = round(stop / step)
    drives = np.stack([np.interp(np.arange(count) * step, drive.series.time, drive.series[name]) for name in driven])

    def exchange() -> list[float]:
        outputs = car.get(OUTPUTS)
        for k, corner in enumerate(cases.CORNERS):
            shocks[corner].set(PORT, (outputs[k], outputs[k + 4]))
        car.set(forces, [shock.get(("force",))[0] for shock in shocks.values()])
        return outputs

    everyone = (car, *shocks.values())
    try:
        for one in everyone:
            one.begin(0.0, stop, {})
        car.set(driven, drives[:, 0].tolist())
        for _ in range(10):  # consistent start: values are exchanged repeatedly in initialization mode
            exchange()
        for one in everyone:
            one.end_initialization()
        rows = [exchange()]
        for k in range(count):
            car.set(driven, drives[:, k].tolist())
            for one in everyone:
                one.step(k * step, step)
            rows.append(exchange())
        return np.array(rows).T
    finally:
        for one in everyone:
            one.finish()


def errors(case: cases.Case, folder: Path, rate: float) -> tuple[float, float]:
    """Return the errors of shock velocity and tire force [%]; infinite if the host diverges."""
    try:
        rows = plain_host(folder, case.drive, case.stop, 1.0 / rate)
    except StepError:
        return np.inf, np.inf
    per_sample = (
        float(case.time[1]) * rate
    )  # steps per sample; less than 1 if the host is slower than the reference's sampling
    kept = rows[:, :: max(1, round(per_sample))]
    velocity, tire_force = kept[:4], kept[8:]
    at = slice(None, None, max(1, round(1.0 / per_sample)))
    settled = case.time[at] >= cases.SETTLING
    static = tire_force[:, :1] - case.tire_force[:, :1]
    pairs = ((velocity, case.velocity[:, at]), (tire_force - static, case.tire_force[:, at]))
    first, second = (
        float(np.max(100 * cases.rms((found - true)[:, settled]) / np.std(true[:, settled], axis=1)))
        for found, true in pairs
    )
    return (first, second) if max(first, second) < 1e3 else (np.inf, np.inf)


def draw(rows: list[tuple[float, float, float]], ours: list[tuple[float, float, float]], path: Path) -> None:
    """Draw the error over the rate."""
    figure, axes = plt.subplots(figsize=(7.0, 4.2), layout="constrained")
    for label, table, line in (("plain host: parallel, held", rows, "o-"), ("eightpost run", ours, "s--")):
        rates, velocity, tire_force = np.array(table).T
        for name, values, color in (("shock velocity", velocity, "C0"), ("tire force", tire_force, "C3")):
            shown = np.isfinite(values)
            axes.loglog(rates[shown], values[shown], line, color=color, label=f"{name}, {label}")
    axes.axhline(1.0, color="0.6", linewidth=0.8)
    axes.set_xlabel("communication rate [Hz]")
    axes.set_ylabel("error [% of standard deviation]")
    axes.set_xticks(RATES, [str(rate) for rate in RATES])
    axes.minorticks_off()
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=130)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", type=Path, help="picture file for the error over the rate")
    options = parser.parse_args()
    drive = Drivefile.read(cases.ROOT / "examples" / "data" / "track.parquet")
    case = cases.make_case(cases.fitted_law(), drive, 10.0, record_step=0.008)
    with tempfile.TemporaryDirectory() as name:
        cases.build_fmus(case.law, Path(name))
        rows = [(float(rate), *errors(case, Path(name), rate)) for rate in RATES]
        ours = [measure(case, Path(name), cosim.GaussSeidel(), 1.0 / rate) for rate in RATES]
    print("| rate | step [ms] | shock velocity [%] | tire force [%] | eightpost: velocity | tire force |")
    print("|---|---|---|---|---|---|")
    pairs = [(r["rate_hz"], r["error_velocity_percent"], r["error_tire_force_percent"]) for r in ours]
    for (rate, *host), (_, *own) in zip(rows, pairs, strict=True):
        cells = [*map(_cell, host), *map(_cell, own)]
        print(f"| {rate:g} Hz | {1e3 / rate:g} | {' | '.join(cells)} |")
    if options.picture:
        draw(rows, [pair for pair in pairs if None not in pair], options.picture)


def _cell(value: float | None) -> str:
    return "diverges" if value is None or not np.isfinite(value) else f"{value:.2g}"


if __name__ == "__main__":
    main()
