"""Identification of true cars, judged by the truth.

    python -m benchmarks.cars --kinds links rubber --seeds 1 2 --kept rows/
    python -m benchmarks.cars --kinds links --seeds 1 --seconds 60 --procedures --kept rows/
    python -m benchmarks.cars --seeds 1 2 3 --record-check --kept rows/

Each row is kept in the folder, and read from it when the command is given again. Seeds from 1000 are for reports.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchmarks.cars import record_check, tables
from benchmarks.cars.draw import KINDS
from benchmarks.cars.judge import Case, row_of
from benchmarks.cars.laps import LAPS
from benchmarks.cars.procedures import PROCEDURES


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="kinds of cars")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1], help="seeds of each kind")
    parser.add_argument("--seconds", type=float, default=200.0, help="length of each of the five tests")
    parser.add_argument("--lap", choices=LAPS, default="track", help="lap on which setups are judged")
    parser.add_argument("--shocks", choices=("known", "fitted"), default="known", help="laws that the study has")
    parser.add_argument("--procedures", nargs="*", choices=PROCEDURES, help="bad procedures; without names all")
    parser.add_argument("--record-check", action="store_true", help="findings in sound records and in faulty ones")
    parser.add_argument("--kept", type=Path, required=True, help="folder of the rows")
    given = parser.parse_args()
    if given.record_check:
        found = []
        for row in record_check.rows(given.kinds, given.seeds):
            found.append(row)
            print(row, file=sys.stderr, flush=True)
        given.kept.mkdir(parents=True, exist_ok=True)
        (given.kept / "record_check.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        print(record_check.table(found))
        return
    names = ["control"] if given.procedures is None else given.procedures or list(PROCEDURES)
    rows = []
    for seed in given.seeds:
        for kind in given.kinds:
            for name in names:
                rows.append(row_of(Case(kind, seed, given.seconds, name, given.lap, given.shocks), given.kept))
                print(f"{kind} {seed} {name}: done", file=sys.stderr, flush=True)
    if given.procedures is not None:
        print(tables.procedures(rows))
        return
    print(tables.summary(rows))
    print("", *tables.by_quantity([row for row in rows if "predicted" in row]), sep="\n")


if __name__ == "__main__":
    main()
