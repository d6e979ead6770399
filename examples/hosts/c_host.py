"""A C program as the host (c_host.c with force_law.h): compiled here, run for every loop and step.

python examples/hosts/c_host.py [--steps 8 4 2 1] [--seconds 10]
"""

import subprocess
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import reference
from reference import Case, Motion

from eightpost.archive import extract_archive
from eightpost.compilers import find_compiler
from eightpost.signals import Drivefile


@cache
def program(source: str = "c_host.c", *libraries: str) -> Path:
    """Compile a program of this folder, with libraries, and return its path."""
    made = Path(tempfile.mkdtemp(prefix="host_")) / Path(source).stem
    flags = ["-O2", "-Wall", "-Wextra"]
    line = [*find_compiler(), *flags, str(reference.HERE / source), "-o", str(made), "-lm", "-ldl", *libraries]
    subprocess.run(line, check=True)
    return made


def write_car(path: Path) -> None:
    """Write the numbers that the program reads."""
    car, drive = reference.car(), Drivefile.read(reference.TRACK).series
    times = np.asarray(drive.time)
    rows = [reference.track()(t) for t in times.tolist()]
    parts = [np.diag(car.M), car.K, car.S, car.tire_stiffness, car.equilibrium(), [times[1], len(rows)], rows]
    path.write_text(
        "\n".join(" ".join(repr(float(x)) for x in np.ravel(part)) for part in parts) + "\n", encoding="utf-8"
    )


def run(make: Callable[[], Path], loop: str, case: Case) -> Motion:
    """Run the program and read its result."""
    folder = case.shock.parent
    if not (folder / "unpacked").exists():
        extract_archive(case.shock, folder / "unpacked")
        write_car(folder / "car.txt")
    result = folder / "result.txt"
    line = [make(), folder / "car.txt", folder / "unpacked", loop, case.step, case.seconds, result]
    ran = subprocess.run(list(map(str, line)), check=True, capture_output=True, text=True)
    table = np.loadtxt(result)
    return Motion(table[:, 0], table[:, 1:5].T, table[:, 5:].T, float(ran.stdout))


HOST = "C program, RK4"
LOOPS = {loop: partial(run, program, loop) for loop in "ABC"}

if __name__ == "__main__":
    reference.main(HOST, LOOPS, sources=("c_host.c", "car.h"))
