"""Benchmark of FMUs in a loop as on a hardware-in-the-loop simulator: set, step and get at 1 and 4 kHz.

    python -m benchmarks.real_time [--seconds 60] [--rates 1000 4000] [--passes 20]

Runs one shock, the seven-DOF car with four shocks as five FMUs, and both assembled in one FMU, in C
(benchmarks/real_time.c, Linux with glibc). Prints for the paced loop its allocations, page faults and late steps and
the cost of a step; for the same steps repeated without waiting the minimum of each step; and the system calls during
the steps. On a machine that is not real time, the paced loop shows the operating system and other programs; the
minimum shows the FMUs. Cost includes reading the clock.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import fmpy

from benchmarks import case as cases
from builder.assembly import assemble
from builder.native.toolchain import fmi_headers
from cosim import Bond, System
from eightpost.archive import extract_archive
from eightpost.corners import CORNERS

#: Amplitudes of the triangular inputs [SI].
AMPLITUDES = {"velocity": 0.5, "displacement": 0.01, "road": 0.005}
EDGES = ("< 100 ns", "< 200 ns", "< 500 ns", "< 1 us", "< 2 us", "< 5 us", "< 10 us", "< 100 us", "< 1 ms", "longer")


@dataclass(frozen=True)
class Unit:
    """One FMU of a system: its file, inputs with amplitude and source (FMU, output; -1 is a triangle), and outputs."""

    path: Path
    inputs: dict[str, tuple[float, int, int]]
    outputs: tuple[str, ...]

    def lines(self, folder: Path) -> list[str]:
        """Return the lines for real_time.c; the FMU is unpacked to `folder`."""
        extract_archive(self.path, folder)
        description = fmpy.read_model_description(str(folder))
        references = {v.name: v.valueReference for v in description.modelVariables}
        name = f"{description.coSimulation.modelIdentifier}{fmpy.sharedLibraryExtension}"
        library = folder / "binaries" / fmpy.platform / name
        return [
            f"{library} {description.guid} {len(self.inputs)} {len(self.outputs)}",
            *(f"{references[name]} {' '.join(map(str, source))}" for name, source in self.inputs.items()),
            *(str(references[name]) for name in self.outputs),
        ]


@dataclass(frozen=True)
class Result:
    """Counts and distributions of one system at one rate: p50, p99, p99.99 and maximum [ns], then the histogram."""

    counts: dict[str, list[int]]

    def quantiles(self, loop: str) -> str:
        """Return p50, p99, p99.99 and maximum as cells of a table [us]."""
        return " | ".join(f"{value / 1000:.3g}" for value in self.counts[loop][:4])

    def histogram(self, loop: str) -> str:
        """Return the counts of the bins as cells of a table."""
        return " | ".join(map(str, self.counts[loop][4:]))


def driven(*names: str) -> dict[str, tuple[float, int, int]]:
    """Return the sources of inputs that follow the triangle."""
    return {name: (AMPLITUDES[name.rpartition(".")[2]], -1, 0) for name in names}


def systems(folder: Path) -> dict[str, list[Unit]]:
    """Build the FMUs and return each system's units by its name."""
    cases.build_fmus(cases.fitted_law(), folder)
    car, shock, whole = (folder / f"{name}.fmu" for name in ("car", "shock", "whole"))
    files = {"car": car} | dict.fromkeys(CORNERS, shock)
    bonds = [Bond.between(f"car.{corner}", corner) for corner in CORNERS]
    assemble(System.load(files, bonds).wiring(files, name="whole"), whole)
    roads = tuple(f"{corner}.road" for corner in CORNERS)
    forces = {f"{corner}.force": (1.0, k + 1, 0) for k, corner in enumerate(CORNERS)}
    port = tuple(f"{corner}.{name}" for corner in CORNERS for name in ("velocity", "displacement"))
    shocks = [
        Unit(shock, {"velocity": (1.0, 0, 2 * k), "displacement": (1.0, 0, 2 * k + 1)}, ("force",))
        for k in range(len(CORNERS))
    ]
    return {
        "one shock": [Unit(shock, driven("velocity", "displacement"), ("force",))],
        "car and four shocks": [Unit(car, {**driven(*roads), **forces}, port), *shocks],
        "car and four shocks in one FMU": [
            Unit(whole, driven(*(f"car.{road}" for road in roads)), tuple(f"car.{name}" for name in port))
        ],
    }


def compiled(folder: Path) -> Path:
    """Compile the loop with the system's compiler.

    Raises:
        SystemExit: There is no compiler.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise SystemExit("real_time: no C compiler (cc or gcc) on this machine")
    program = folder / "real_time"
    source = Path(__file__).with_name("real_time.c")
    line = [compiler, "-std=c99", "-O2", "-rdynamic", "-I", str(fmi_headers()), str(source), "-o", str(program), "-ldl"]
    subprocess.run(line, check=True)
    return program


def run(program: Path, units: Sequence[Unit], folder: Path, *, seconds: float, rate: float, passes: int) -> Result:
    """Run a system of FMUs; `folder` receives the unpacked FMUs."""
    lines = [line for k, unit in enumerate(units) for line in unit.lines(folder / str(k))]
    ran = subprocess.run(
        [str(program), str(seconds), str(rate), str(passes)],
        input="\n".join(lines),
        capture_output=True,
        text=True,
        check=True,
    )
    rows = (line.split() for line in ran.stdout.splitlines())
    return Result({name: list(map(int, numbers)) for name, *numbers in rows})


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="duration of each paced run [s]")
    parser.add_argument("--rates", type=float, nargs="+", default=[1000.0, 4000.0], help="steps per second [Hz]")
    parser.add_argument("--passes", type=int, default=20, help="number of repetitions without waiting")
    options = parser.parse_args()
    results: list[tuple[str, Result]] = []
    with tempfile.TemporaryDirectory() as name:
        program = compiled(Path(name))
        for label, units in systems(Path(name)).items():
            for rate in options.rates:
                folder = Path(name) / f"{label} {rate:g}".replace(" ", "_")
                result = run(program, units, folder, seconds=options.seconds, rate=rate, passes=options.passes)
                results.append((f"{label} | {rate:g} Hz", result))
    print_tables(results)


def print_tables(results: Sequence[tuple[str, Result]]) -> None:
    """Print counts, cost and histograms."""
    print("| system | rate | steps | allocations | page faults | system calls | late steps |")
    print("|---|---|---|---|---|---|---|")
    for label, result in results:
        cells = [result.counts[key][0] for key in ("steps", "allocations", "page_faults", "system_calls", "late")]
        print(f"| {label} | {' | '.join(map(str, cells))} |")
    print("\nCost of a step [us]\n\n| system | rate | loop | p50 | p99 | p99.99 | max |\n|---|---|---|---|---|---|---|")
    for label, result in results:
        for loop in ("minimum", "paced"):
            print(f"| {label} | {loop} | {result.quantiles(loop)} |")
    print(f"\n| system | rate | loop | {' | '.join(EDGES)} |\n|---|---|---|{'---|' * len(EDGES)}")
    for label, result in results:
        for loop in ("minimum", "paced"):
            print(f"| {label} | {loop} | {result.histogram(loop)} |")
    print(f"\nReading the clock: {results[0][1].counts['clock'][0]} ns")


if __name__ == "__main__":
    main()
