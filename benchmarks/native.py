"""What a step of a native FMU costs: against the python FMU, through the same fmpy loop, and the build's times.

    python benchmarks/native.py

Ratios are of one run on one machine; absolute times are that machine's.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

from builder.build import build
from cosim import FmuComponent
from eightpost.shock import Lpf1, Lpnl2, Polylinear, Shock, StaticCurve, law_name, write_shock
from eightpost.vehicle import shipped

STEPS, REPEATS = 5000, 5


def main() -> None:
    """Build four FMUs for both targets, time their steps, print a table."""
    with tempfile.TemporaryDirectory() as folder:
        sources = _sources(Path(folder))
        os.environ["EIGHTPOST_CACHE"] = str(Path(folder) / "cache")
        for label in ("cold", "warm"):
            begin = time.perf_counter()
            native = build(sources, Path(folder) / "native")
            print(f"build of {len(native)} FMUs, {label}: {time.perf_counter() - begin:.1f} s")
        python = build(sources, Path(folder) / "python", target="python")
        print("| FMU | size [KiB] | native [us] | python [us] | ratio |\n|---|---|---|---|---|")
        for one, other in zip(native, python, strict=True):
            fast, slow = _microseconds(one.path), _microseconds(other.path)
            size = one.path.stat().st_size / 1024
            print(f"| {one.path.stem} | {size:.0f} | {fast:.1f} | {slow:.1f} | {slow / fast:.0f} |")


def _sources(folder: Path) -> list[Path]:
    curve = StaticCurve(
        (1800.0, 60.0, -400.0, *[0.0] * 12), (1490.0, 900.0, 40.0, 5.0), (-1400.0, -1100.0, -20.0, 3.0),
        0.381, 0.0127, 1.2, 1.1, 3000.0, 3500.0,
    )  # fmt: skip
    laws = (Polylinear(curve), Lpf1(curve, 0.0013), Lpnl2(curve, 0.0013, 800.0, 1600.0))
    files = []
    for law in laws:
        files.append(folder / f"{law_name(type(law))}.json")
        write_shock(Shock(law_name(type(law)), law), files[-1])
    return [*files, shipped("seven_dof")]


def _microseconds(path: Path) -> float:
    """Median time of set, step and get through fmpy."""
    fmu = FmuComponent(path, "timed")
    fmu.begin(0.0, 1e6, {})
    fmu.end_initialization()
    variables = fmu.variables.values()
    name = next(v.name for v in variables if v.causality == "input")
    outputs = tuple(v.name for v in variables if v.causality == "output")[:14]
    times, at = [], 0.0
    for _ in range(REPEATS):
        begin = time.perf_counter()
        for k in range(STEPS):
            fmu.set((name,), (0.1 * (k % 7),))
            fmu.step(at, 1e-3)
            fmu.get(outputs)
            at += 1e-3
        times.append((time.perf_counter() - begin) / STEPS * 1e6)
    fmu.finish()
    return statistics.median(times)


if __name__ == "__main__":
    main()
