"""Lower limit of the cost: a loop in C over the same FMUs (master.c), with nothing around it."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import fmpy
import numpy as np

from benchmarks.engines.fmpy_loop import SCHEMES
from benchmarks.engines.runs import CAR_OUTPUTS, CORNERS, DRIVEN, Diverged, Job, Recording
from builder.toolchain import fmi_headers
from eightpost.archive import extract_archive

#: Exit code of the program if an FMU refuses a call.
_REFUSED = 3


def run(job: Job) -> Recording:
    """Run the program."""
    folder = job.work
    car, shock = (_unpacked(job.fmus[name]) for name in ("car", "lf"))
    asked, found = folder / "job.bin", folder / "result.bin"
    drive = job.drive(np.arange(job.count + 1) * job.step)
    head = [SCHEMES.index(job.scheme), job.count, job.step, job.stop, *_references(car, shock)]
    np.concatenate([head, drive.ravel()]).tofile(asked)
    line = [str(_program()), *_library(car), *_library(shock), str(asked), str(found)]
    ran = subprocess.run(line, capture_output=True, text=True, check=False)
    if ran.returncode == _REFUSED:
        raise Diverged(ran.stderr.strip())
    if ran.returncode != 0:
        raise RuntimeError(f"{line[0]} ended with {ran.returncode}: {ran.stderr.strip()}")
    seconds, *rows = np.fromfile(found)
    times = np.arange(job.count + 1) * job.step
    return Recording(times, np.reshape(rows, (-1, 14)).T, float(seconds), job.count, job.rate)


@cache
def _program() -> Path:
    """Compile master.c."""
    source, program = Path(__file__).with_name("master.c"), Path(mkdtemp(prefix="c_loop_")) / "master"
    line = [sys.executable, "-m", "ziglang", "cc", "-std=c99", "-O2", "-Wall", "-Wextra", "-ffp-contract=off"]
    subprocess.run([*line, "-I", str(fmi_headers()), str(source), "-o", str(program), "-ldl"], check=True)
    return program


@cache
def _unpacked(path: Path) -> Path:
    folder = Path(mkdtemp(prefix="c_loop_"))
    extract_archive(path, folder)
    return folder


def _library(folder: Path) -> tuple[str, str]:
    """Return the binary of an unpacked FMU, and its GUID."""
    description = fmpy.read_model_description(str(folder))
    name = f"{description.coSimulation.modelIdentifier}{fmpy.sharedLibraryExtension}"
    return str(folder / "binaries" / fmpy.platform / name), description.guid


def _references(car: Path, shock: Path) -> list[int]:
    """Return the references in the order of master.c: the car's inputs and state, a shock's port and force."""
    inputs = (*DRIVEN, *(f"{c}.force" for c in CORNERS))
    port = tuple(f"{c}.{name}" for name in ("velocity", "displacement") for c in CORNERS)
    names = ((car, (*inputs, *port, *CAR_OUTPUTS)), (shock, ("velocity", "displacement", "force")))
    return [reference for folder, wanted in names for reference in map(_by_name(folder).__getitem__, wanted)]


def _by_name(folder: Path) -> dict[str, Any]:
    return {v.name: v.valueReference for v in fmpy.read_model_description(str(folder)).modelVariables}
