"""Benchmark of native FMUs: cost of a step compared with Python FMUs and in a C loop, file sizes, build times.

    python benchmarks/native.py
    taskset -c 1 python benchmarks/native.py --cost

A step consists of the calls of a coupling master: set all inputs, with or without their derivatives, fmi2DoStep, get
the port's outputs. Ratios are from one run on one machine; absolute times are valid for that machine only. The worst
case is the slowest of 200,000 steps: on a busy machine, it is dominated by the operating system. `--cost` prints only
the costs of the laws relative to Polylinear, which the files of the laws state as `STEP_COST`.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from builder.build import build
from builder.native.toolchain import fmi_headers
from cosim import FmuComponent
from eightpost.archive import extract_archive
from eightpost.corners import CORNERS
from eightpost.shock import (
    LAWS,
    Hysteresis,
    Lpf1,
    Lpnl2,
    Polylinear,
    Shock,
    StaticCurve,
    law_name,
    state_names,
    write_shock,
)
from eightpost.vehicle import Channel, IdentifiedVehicle, StateSpace, shipped, write_vehicle

STEPS, REPEATS, C_STEPS = 5000, 5, 200_000
ROUNDS = 15
AMPLITUDES = {"velocity": 0.5, "displacement": 0.02, "force": 500.0, "road": 0.005}
PORT = ("force", "velocity", "displacement")

#: The first FMUs are those of the shocks.
SHOCKS = len(LAWS)


def main() -> None:
    """Build FMUs, measure times and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cost", action="store_true", help="Print only the relative costs of the laws.")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources = _sources(folder)
        if parser.parse_args().cost:
            _cost_table([one.path for one in build(sources[:SHOCKS], folder / "native")], folder)
            return
        os.environ["EIGHTPOST_CACHE"] = str(folder / "cache")
        for label in ("cold", "warm"):
            begin = time.perf_counter()
            native = build(sources[: SHOCKS + 1], folder / "native")
            print(f"build of {len(native)} FMUs, {label}: {time.perf_counter() - begin:.1f} s")
        python = build(sources[: SHOCKS + 1], folder / "python", target="python")
        native += build(sources[SHOCKS + 1 :], folder / "native")
        _fmpy_table([one.path for one in native[: SHOCKS + 1]], [one.path for one in python])
        _c_table([one.path for one in native], folder)
        _cost_table([one.path for one in native[:SHOCKS]], folder)
        _sizes([one.path for one in native])


def _sources(folder: Path) -> list[Path]:
    curve = StaticCurve(
        (1800.0, 60.0, -400.0, *[0.0] * 12), (1490.0, 900.0, 40.0, 5.0), (-1400.0, -1100.0, -20.0, 3.0),
        0.381, 0.0127, 1.2, 1.1, 3000.0, 3500.0,
    )  # fmt: skip
    laws = (
        Polylinear(curve), Lpf1(curve, 0.0013), Lpnl2(curve, 0.0013, 800.0, 1600.0), _hysteresis(),
    )  # fmt: skip
    files = []
    for law in laws:
        files.append(folder / f"{law_name(type(law))}.json")
        write_shock(Shock(law_name(type(law)), law), files[-1])
    write_vehicle(folder / "states_150.json", IdentifiedVehicle("states_150", _large_model(150)))
    return [*files, shipped("seven_dof"), shipped("quarter_car"), folder / "states_150.json"]


def _hysteresis() -> Hysteresis:
    """Return a law with a stop on a digressive curve through knots with quadratic cells."""
    velocity = 1.2 * np.sign(np.arange(-12, 13)) * (np.abs(np.arange(-12, 13)) / 12) ** 1.8
    slope = 1500.0 + 3300.0 / (1.0 + (velocity / 0.12) ** 2)
    force = np.concatenate(([0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(velocity))))
    curve = StaticCurve.through_knots(*(tuple(one.tolist()) for one in (velocity, force - force[12], slope)))
    return Hysteresis(curve, tuple((0.6 * slope).tolist()), (0.004, 0.001, 0.002), 1e5, 4e-4, 0.01)


def _large_model(states: int) -> StateSpace:
    """Return a car with many lightly damped modes and the channels of a four-corner rig."""
    rng = np.random.default_rng(states)
    A = np.zeros((states, states))
    for k in range(0, states, 2):
        omega = rng.uniform(5.0, 400.0)
        A[k : k + 2, k : k + 2] = [[-0.1 * omega, omega], [-omega, -0.1 * omega]]
    inputs = tuple(Channel(f"{c}.{n}", u) for n, u in (("force", "N"), ("road", "m")) for c in CORNERS)
    outputs = tuple(Channel(f"{c}.{n}", u) for n, u in (("velocity", "m/s"), ("tire_force", "N")) for c in CORNERS)
    B, C = rng.standard_normal((states, 8)), rng.standard_normal((8, states))
    D = np.zeros((8, 8))
    D[4:, 4:] = 3e5 * np.eye(4)
    return StateSpace(A, B, C, D, inputs, outputs, name=f"states_{states}")


def _fmpy_table(native: list[Path], python: list[Path]) -> None:
    print("\nIn an fmpy loop (cosim.FmuComponent):\n\n| FMU | native [us] | python [us] | ratio |\n|---|---|---|---|")
    for one, other in zip(native, python, strict=True):
        fast, slow = _microseconds(one), _microseconds(other)
        print(f"| {one.stem} | {fast:.1f} | {slow:.1f} | {slow / fast:.1f} |")


def _microseconds(path: Path) -> float:
    """Return the median time of set, step and get with fmpy."""
    fmu = FmuComponent(path, "timed")
    fmu.begin(0.0, 1e6, {})
    fmu.end_initialization()
    inputs, outputs = _port(fmu.variables.values())
    times, at = [], 0.0
    for _ in range(REPEATS):
        begin = time.perf_counter()
        for k in range(STEPS):
            fmu.set(inputs, [AMPLITUDES[name.rpartition(".")[2]] * 0.1 * (k % 7) for name in inputs])
            fmu.step(at, 1e-3)
            fmu.get(outputs)
            at += 1e-3
        times.append((time.perf_counter() - begin) / STEPS * 1e6)
    fmu.finish()
    return statistics.median(times)


def _port(variables: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the inputs that have an amplitude, and the outputs of ports."""
    inputs = tuple(v.name for v in variables if v.causality == "input" and v.name.rpartition(".")[2] in AMPLITUDES)
    return inputs, tuple(v.name for v in variables if v.causality == "output" and v.name.rpartition(".")[2] in PORT)


def _c_table(fmus: list[Path], folder: Path) -> None:
    program = _step_program(folder)
    if program is None:
        print("\nThe C loop is skipped: neither a C compiler nor ziglang is installed.")
        return
    print(
        f"\nIn a C loop, {C_STEPS:,} steps; mean [ns], median of {REPEATS} runs (1 in 1,000; worst, of the last run):\n"
    )
    print("| FMU | states | inputs | held | ramped | ramped, irregular steps |\n|---|---|---|---|---|---|")
    for path in fmus:
        where = _unpacked(path, folder)
        cells = [_nanoseconds(program, where, kind) for kind in ("held", "ramped", "irregular")]
        description = fmpy.read_model_description(str(where))
        counts = f"{_states(path)} | {len(_port(description.modelVariables)[0])}"
        print(f"| {path.stem} | {counts} | {' | '.join(cells)} |")


def _cost_table(fmus: list[Path], folder: Path) -> None:
    """Print the cost of a ramped step of each FMU relative to the first; the runs of all FMUs take turns."""
    program = _step_program(folder)
    if program is None:
        return
    lines = [_line(program, _unpacked(path, folder), "ramped") for path in fmus]
    fastest = np.min([[_run(line)[0] for line in lines] for _ in range(ROUNDS)], axis=0)
    print(f"\nRamped steps in a C loop, minimum of {ROUNDS} runs:\n\n| law | time [ns] | cost |\n|---|---|---|")
    for path, time_of_step in zip(fmus, fastest, strict=True):
        print(f"| {path.stem} | {time_of_step:.0f} | {time_of_step / fastest[0]:.2f} |")


def _step_program(folder: Path) -> Path | None:
    """Compile the C loop; return None without a compiler."""
    compiler, program = _compiler(), folder / "step"
    if compiler is None or program.exists():
        return program if compiler else None
    source = str(Path(__file__).with_name("step.c"))
    subprocess.run(
        [*compiler, "-std=c99", "-O2", "-I", str(fmi_headers()), source, "-o", str(program), "-ldl"], check=True
    )
    return program


def _unpacked(path: Path, folder: Path) -> Path:
    where = folder / "unpacked" / path.stem
    if not where.exists():
        extract_archive(path, where)
    return where


def _states(path: Path) -> int:
    """Return the number of states: for a vehicle, from its source."""
    if path.stem in LAWS:
        return len(state_names(LAWS[path.stem]))
    with zipfile.ZipFile(path) as archive:
        text = archive.read("sources/vehicle_data.h").decode()
    counts = dict(re.findall(r"\b([A-Z]+_COUNT) = (\d+)", text))
    return int(counts["MODE_COUNT"]) + int(counts["PAIR_COUNT"])


def _compiler() -> list[str] | None:
    if found := shutil.which("cc"):
        return [found]
    try:
        import ziglang  # noqa: F401, PLC0415
    except ImportError:
        return None
    return [sys.executable, "-m", "ziglang", "cc"]


def _line(program: Path, where: Path, kind: str) -> list[str]:
    """Return the command that times the steps of an unpacked FMU."""
    description = fmpy.read_model_description(str(where))
    inputs, outputs = _port(description.modelVariables)
    references = {v.name: str(v.valueReference) for v in description.modelVariables}
    library = (
        where / "binaries" / fmpy.platform / f"{description.coSimulation.modelIdentifier}{fmpy.sharedLibraryExtension}"
    )
    amplitudes = [str(AMPLITUDES[name.rpartition(".")[2]]) for name in inputs]
    line = [str(program), str(library), description.guid, str(C_STEPS), kind]
    line += [",".join(part) for part in ([references[n] for n in inputs], amplitudes, [references[n] for n in outputs])]
    return line


def _run(line: list[str]) -> list[float]:
    """Return the mean, the slowest of 1,000 and the worst time of a step [ns]."""
    return [float(number) for number in subprocess.run(line, check=True, capture_output=True, text=True).stdout.split()]


def _nanoseconds(program: Path, where: Path, kind: str) -> str:
    line = _line(program, where, kind)
    runs = [_run(line) for _ in range(REPEATS)]
    return f"{statistics.median(run[0] for run in runs):.0f} ({runs[-1][1]:.0f}; {runs[-1][2]:.0f})"


def _sizes(fmus: list[Path]) -> None:
    print("\nSizes [KiB]:\n")
    platforms: list[str] = []
    for path in fmus:
        with zipfile.ZipFile(path) as archive:
            members = {i.filename: i for i in archive.infolist()}
        binaries = {name.split("/")[1]: i.file_size for name, i in members.items() if name.startswith("binaries/")}
        if not platforms:
            platforms = sorted(binaries)
            print(f"| FMU | archive | {' | '.join(platforms)} |\n|---|---|{'---|' * len(platforms)}")
        sizes = " | ".join(f"{binaries.get(platform, 0) / 1024:.0f}" for platform in platforms)
        print(f"| {path.stem} | {path.stat().st_size / 1024:.0f} | {sizes} |")


if __name__ == "__main__":
    main()
