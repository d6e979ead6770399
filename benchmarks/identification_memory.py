"""Benchmark of memory and time of `eightpost identify` from files: five rig tests of 800 s, both recipes.

    python benchmarks/identification_memory.py FOLDER [--duration 800] [--car eight_post]

Creates the files (`eightpost rig --program identification`, linear shocks of 20.74 and 9 lbf/(in/s), 6.3.1) in FOLDER
if they do not exist, runs the identification with each recipe in a separate process, and prints Markdown: time and
memory of the whole command, including reading, preparation, model and pictures.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

#: Options for the shocks of 6.3.1: baseline and alternate.
SHOCKS = ("--shock", "20.74 lbf.s/in", "--alternate", "9 lbf.s/in")
RECIPES = ("boggs", "common-poles")


class Cost(NamedTuple):
    """Time and memory of a process."""

    exit_code: int
    wall_seconds: float
    processor_seconds: float
    peak_gigabytes: float


def main() -> None:
    """Print a row per recipe."""
    options = _options()
    files = sorted(options.folder.glob("*.parquet")) or _made(options)
    size = sum(path.stat().st_size for path in files) / 1e9
    print(f"{len(files)} files, {size:.2f} GB\n")
    print("| recipe | exit code | wall [s] | processor [s] | peak memory [GB] |\n|---|---|---|---|---|", flush=True)
    for recipe in RECIPES:
        with TemporaryDirectory() as folder:
            target = ("--recipe", recipe, "-o", str(Path(folder) / "car.json"))
            cost = cost_of(["identify", *map(str, files), *target])
        row = (f"{cost.wall_seconds:.1f}", f"{cost.processor_seconds:.1f}", f"{cost.peak_gigabytes:.2f}")
        print(f"| {recipe} | {cost.exit_code} | {' | '.join(row)} |", flush=True)


def cost_of(words: list[str]) -> Cost:
    """Run eightpost in a separate process and return its time and memory."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "eightpost", *words]
    began = time.perf_counter()
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)  # Linux and macOS; figures of this child process only
    process.returncode = os.waitstatus_to_exitcode(status)  # otherwise Popen would wait for it
    unit = 1 if sys.platform == "darwin" else 1024
    wall = time.perf_counter() - began
    return Cost(process.returncode, wall, used.ru_utime + used.ru_stime, used.ru_maxrss * unit / 1e9)


def _made(options: argparse.Namespace) -> list[Path]:
    length = ("--duration", f"{options.duration:g} s", "--car", options.car)
    words = ["rig", "--program", "identification", *SHOCKS, *length, "-o", str(options.folder)]
    subprocess.run([sys.executable, "-m", "eightpost", *words], check=True)
    return sorted(options.folder.glob("*.parquet"))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--duration", type=float, default=800.0, help="duration of each test [s]")
    parser.add_argument("--car", default="eight_post")
    return parser.parse_args()


if __name__ == "__main__":
    main()
