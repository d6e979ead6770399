"""Cost per component and memory of systems with many vehicles.

    python -m benchmarks.scaling FOLDER VEHICLES STOP

Each size runs in its own process, so that the memory is that of this size. FOLDER contains car.fmu and shock.fmu.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cosim
from benchmarks.case import CORNERS, ROOT, track
from benchmarks.engines.job import DRIVEN
from benchmarks.table import number
from eightpost.signals import Drivefile, TimeSeries

SIZES = (1, 10, 100)


@dataclass(frozen=True)
class Size:
    """Time and memory [MB] of a process with a system of vehicles with four shocks each."""

    vehicles: int
    load_seconds: float
    us_per_step: float
    before: float
    loaded: float
    peak: float

    @property
    def components(self) -> int:
        """Number of vehicles and shocks."""
        return 5 * self.vehicles


def measure(folder: Path, vehicles: int, stop: float) -> Size:
    """Load a system, run it twice at 1 kHz and return the faster run."""
    drive = _drive(vehicles, stop)
    cosim.run(
        _system(folder, 1), _scenario(_drive(1, 0.1), 1, 0.1), algorithm=cosim.GaussSeidel(), step=1e-3, compared=False
    )
    before, began = _resident(), clock.perf_counter()
    system = _system(folder, vehicles)
    load = clock.perf_counter() - began
    scenario = _scenario(drive, vehicles, stop)
    results = [cosim.run(system, scenario, algorithm=cosim.GaussSeidel(), step=1e-3, compared=False) for _ in range(2)]
    loaded = _resident()
    best = min(result.stepping_seconds / result.steps for result in results)
    return Size(vehicles, load, 1e6 * best, before, loaded, _peak())


def _scenario(drive: Drivefile, vehicles: int, stop: float) -> cosim.Scenario:
    record = tuple(f"car{k}.{c}.tire_force" for k in range(vehicles) for c in CORNERS)
    targets = {f"car{k}.{name}": f"car{k}.{name}" for k in range(vehicles) for name in DRIVEN}
    return cosim.Scenario(stop, drive, targets=targets, record=record, record_step=0.008)


def _system(folder: Path, vehicles: int) -> cosim.System:
    fmus, bonds = {}, []
    for k in range(vehicles):
        fmus[f"car{k}"] = folder / "car.fmu"
        fmus |= {f"{c}{k}": folder / "shock.fmu" for c in CORNERS}
        bonds += [cosim.Bond.between(f"car{k}.{c}", f"{c}{k}") for c in CORNERS]
    return cosim.System.load(fmus, bonds)


def _drive(vehicles: int, stop: float) -> Drivefile:
    """Return the track as drive file for every vehicle."""
    series = track().series.window(0.0, stop)
    places = {name: k for k, name in enumerate(series.names)}
    rows = [places[name] for _ in range(vehicles) for name in DRIVEN]
    names = tuple(f"car{k}.{name}" for k in range(vehicles) for name in DRIVEN)
    units = tuple(series.units[row] for row in rows)
    return Drivefile(TimeSeries(series.time, series.values[rows], names, units))


def _resident() -> float:
    """Return the memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def _peak() -> float:
    import resource  # noqa: PLC0415

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def table(folder: Path, stop: float, sizes: Sequence[int] = SIZES) -> Iterator[str]:
    """Return the table, line by line."""
    found = [_in_process(folder, vehicles, stop) for vehicles in sizes]
    one = found[0]
    yield (
        "| vehicles + shocks | us per step | us per step and component | of 1 + 4 | load [s] | memory [MB] | "
        "MB per component |"
    )
    yield "|---|---|---|---|---|---|---|"
    for size in found:
        each = size.us_per_step / size.components
        share = each / (one.us_per_step / one.components)
        memory = size.loaded - size.before
        yield (
            f"| {size.vehicles} + {4 * size.vehicles} | {number(size.us_per_step)} | {number(each)} | {share:.2f} | "
            f"{number(size.load_seconds)} | {number(memory)} | {number(memory / size.components)} |"
        )


def _in_process(folder: Path, vehicles: int, stop: float) -> Size:
    line = [sys.executable, "-m", "benchmarks.scaling", str(folder), str(vehicles), str(stop)]
    ran = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)
    if ran.returncode:
        raise RuntimeError(f"{vehicles} vehicles could not run: {ran.stderr[-2000:]}")
    result: dict[str, Any] = json.loads(ran.stdout.strip().splitlines()[-1])
    return Size(**result)


def main() -> None:
    """Measure one size."""
    folder, vehicles, stop = sys.argv[1:]
    print(json.dumps(vars(measure(Path(folder), int(vehicles), float(stop)))))


if __name__ == "__main__":
    main()
