"""Comparison of the stated coupling error with the true one: random systems against an independent reference.

    python -m benchmarks.honesty [--systems 400] [--seed-base 0] [--workers 2] [--schemes default] [--json rows.jsonl]

Every system is drawn from its seed alone (benchmarks/honesty/cases.py). `--json` stores a row for each run; an
interrupted campaign resumes where it stopped. `--against` compares the cost with another campaign's file.
"""

from __future__ import annotations

import argparse
import time as clock
from pathlib import Path

from benchmarks.honesty.campaign import read_rows, run_campaign
from benchmarks.honesty.picture import draw
from benchmarks.honesty.summary import against, lines


def main() -> None:
    """Run and print."""
    options = _options()
    seeds = options.only or range(options.seed_base, options.seed_base + options.systems)
    began = clock.perf_counter()
    rows = run_campaign(seeds, options.schemes, workers=options.workers, keep=options.json)
    for title, chosen in (
        ("the default", [row for row in rows if row["scheme"] == "default"]),
        ("given steps", [row for row in rows if row["scheme"] != "default"]),
    ):
        if chosen:
            print("\n".join([f"\n== {title}", *lines(chosen, names=options.names)]))
            if options.against:
                print("\n".join(against(chosen, read_rows(options.against))))
    print(f"\n{clock.perf_counter() - began:.0f} s")
    if options.plot:
        draw([row for row in rows if row["scheme"] == "default"] or rows, options.plot)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.honesty", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--systems", type=int, default=400, help="number of systems")
    parser.add_argument("--seed-base", type=int, default=0, help="seed of the first system")
    parser.add_argument("--only", type=int, nargs="+", help="seeds to run, instead of a range")
    parser.add_argument("--workers", type=int, default=2, help="number of processes")
    parser.add_argument(
        "--schemes",
        choices=("default", "given", "all", "every"),
        default="default",
        help="given: eight of the forty schemes at given steps, drawn for each system; all: with the default; every: "
        "the default and all forty",
    )
    parser.add_argument("--json", type=Path, help="file for the rows; rows already in it are not computed again")
    parser.add_argument("--against", type=Path, help="another campaign's file, to compare the cost with")
    parser.add_argument("--plot", type=Path, help="output file for a plot of the distribution")
    parser.add_argument("--names", type=int, default=8, help="number of worst runs to list, of each kind")
    return parser.parse_args()


if __name__ == "__main__":
    main()
