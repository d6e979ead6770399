"""Digests of everything that the commands write: equal digests before and after a change, equal bits.

    python -m benchmarks.digests [--against CHECKOUT] [--folder FOLDER] > digests.txt

Runs the demonstration (fit, build, run, study with its certainty and pages), fits of all laws, runs with the default
and at a given step, the identification of a seven-DOF car and an 8-post stand-in from the virtual rig, and validations
with this checkout, and with the one of --against, which may also be a file with the digests of an earlier call.

The digest of a table, a series or a JSON file covers its numbers and booleans in their order, to the last bit. Texts
and durations of the calculation are left out, so that a reworded message changes nothing. The digest of a page or of an
FMU's modelDescription.xml covers its text without dates, versions, identifiers and durations.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet

#: Keys of JSON whose values are durations of the calculation, versions or names of this run.
_NOT_RESULTS = {"created", "version", "workers", "sources"}

#: What differs between two runs of the same code: dates, versions, folders, identifiers and digests, durations.
OF_THIS_RUN = re.compile(
    r"\d{4}-\d\d-\d\d([T ][\d:.]+(Z|[+-]\d\d:\d\d)?)?|\b\d+\.\d+\.\d+\b"
    r"|\{?[0-9a-f]{8}(-?[0-9a-f]{4}){3}-?[0-9a-f]{12}\}?|\b[0-9a-f]{12,64}\b|\b\d+(\.\d+)? (s|ms|min)\b"
    r"|(?<![<\w])/([\w.+-]+/)+"
)

_ROOT = Path(__file__).resolve().parents[1]

#: Commands in the order in which their files are made.
_COMMANDS = """
demo -o demo
fit examples/data/dyno_A.csv --law polylinear -o fit/polylinear.json
fit examples/data/dyno_A.csv --law lpf1 -o fit/lpf1.json
fit examples/data/dyno_A.csv --law lpnl2 -o fit/lpnl2.json
fit examples/data/dyno_A.csv -o fit/hysteresis.json
fit examples/data/dyno_A.csv --law lpnl2 --set recipe=boggs -o fit/boggs.json
fit examples/data/dyno_A.csv --law lpnl2 --gas included -o dist/dyno_A.json
build dist/dyno_A.json examples/corner.toml examples/car.toml -o dist
run examples/quarter_car.toml -o run/quarter_car/
run examples/seven_dof.toml -o run/seven_dof/
run examples/seven_dof.toml --step '1 ms' --set comparison=no -o run/given/
virtual rig --car seven_dof --program identification --set duration='40 s' -o rig/seven_dof/
virtual rig --car eight_post --program identification --set duration='40 s' -o rig/eight_post/
identify rig/seven_dof/*.parquet --set recipe=boggs -o cars/seven_dof.json
identify rig/eight_post/*.parquet -o cars/eight_post.json
validate fit/lpnl2.json examples/data/dyno_B.csv --keep -o fit/lpnl2.html
validate cars/eight_post.json rig/eight_post/baseline.parquet --keep -o cars/eight_post.html
"""


def main() -> int:
    """Print a line for each file; with --against, end with 1 where one differs."""
    options = _options()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        lines = _lines(_ROOT, folder / "now")
        print("\n".join(lines))
        if not options.against:
            return 0
        kept = options.against.is_file()
        before = options.against.read_text(encoding="utf-8").splitlines() if kept else []
        before = before or _lines(options.against.resolve(), folder / "then")
    for line in sorted(set(before) ^ set(lines), key=lambda line: line.split(maxsplit=1)[1]):
        print(f"{'now ' if line in lines else 'then'} {line}", file=sys.stderr)
    return int(before != lines)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="folder to keep the files in (default: a temporary one)")
    parser.add_argument("--against", type=Path, help="checkout of another version to compare with, or its digests")
    return parser.parse_args()


def _lines(checkout: Path, folder: Path) -> list[str]:
    """Run the commands of a checkout in a folder; return the lines of its files."""
    folder.mkdir(parents=True, exist_ok=True)
    _run_commands(checkout, folder)
    return [f"{digest}  {name}" for name, digest in _digests(folder)]


def _run_commands(checkout: Path, folder: Path) -> None:
    shutil.copytree(_ROOT / "examples", folder / "examples")
    for line in _COMMANDS.strip().splitlines():
        words = [name for word in shlex.split(line) for name in (sorted(map(str, folder.glob(word))) or [word])]
        _command(checkout, folder, *words)


def _command(checkout: Path, folder: Path, *arguments: str) -> None:
    """Run a command in the folder; 1 says that a result is not acceptable, which is a result too."""
    done = subprocess.run(
        [sys.executable, "-m", "eightpost", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(checkout)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"eightpost {' '.join(arguments)} ended with {done.returncode}:\n{done.stdout}{done.stderr}")


def _digests(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield every file of results with the digest of its numbers, in the order of their names."""
    readers = {
        ".json": _json_numbers,
        ".csv": _csv_numbers,
        ".parquet": _parquet_numbers,
        ".html": _text,
        ".fmu": _description,
    }
    for path in sorted(folder.rglob("*")):
        if path.suffix in readers and "chunks" not in path.parts:  # named after the folder's path
            digest = hashlib.sha256("\n".join(readers[path.suffix](path)).encode()).hexdigest()[:16]
            yield path.relative_to(folder).as_posix(), digest


def _json_numbers(path: Path) -> Iterator[str]:
    yield from _numbers(json.loads(path.read_text(encoding="utf-8")))


def _numbers(content: Any) -> Iterator[str]:
    if isinstance(content, dict):
        for key in sorted(set(content) - _NOT_RESULTS):
            if not key.endswith("seconds"):
                yield from _numbers(content[key])
    elif isinstance(content, list):
        for item in content:
            yield from _numbers(item)
    elif isinstance(content, int | float):
        yield float(content).hex()


def _csv_numbers(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", newline="") as stream:
        for row in csv.reader(stream):
            for cell in row:
                try:
                    yield float(cell).hex()
                except ValueError:
                    continue


def _parquet_numbers(path: Path) -> Iterator[str]:
    table = pyarrow.parquet.read_table(path)
    for name in table.column_names:
        if not name.endswith("seconds") and pyarrow.types.is_primitive(table[name].type):
            yield hashlib.sha256(table[name].to_numpy().tobytes()).hexdigest()


def _text(path: Path) -> Iterator[str]:
    yield OF_THIS_RUN.sub("", path.read_text(encoding="utf-8"))


def _description(path: Path) -> Iterator[str]:
    with zipfile.ZipFile(path) as archive:
        yield OF_THIS_RUN.sub("", archive.read("modelDescription.xml").decode())


if __name__ == "__main__":
    sys.exit(main())
