"""Benchmark of shock laws on shocks outside their model class: error of the fit, error on a held-out run, time.

    python benchmarks/shock_fit.py [--quick] [--json FILE] [--markdown FILE] [--picture FILE] [--configurations 1,5] \
[--laws NAMES] [--recipe joint|boggs] [--processes N]

The twelve configurations of Table 3.1 on the virtual dynamometer (docs/explanation/dynamometer.md), fitted on seconds 1
to 10 of one phase draw and compared with another; draws 11 and 12, which were not used to calibrate the dynamometer;
without
--quick three pairs of draws of 30 s each. If EIGHTPOST_DATA names the folder of measured records, these are used too:
a whole run is held out if a setting has two runs, and Bouc-Wen is fitted for comparison (benchmarks/bouc_wen.py).
Prints Markdown; --json writes rows {record, law, fit_percent, validation_percent, seconds}: RMS errors in percent of
the measured force's standard deviation, after the low-pass of 3.3. The errors of measured records are taken about their
mean, because the zeros of their load cells differ between runs. Values are null if a law could not be fitted. Times are
valid for this machine and this run.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from time import perf_counter

# Small matrices and a process for each core: more threads are slower.
os.environ.setdefault("OMP_NUM_THREADS", "1")

from benchmarks.shock_picture import draw
from benchmarks.shock_records import BOUC_WEN, LAWS
from benchmarks.shock_rows import Bench, FailedFit, Result, results
from benchmarks.shock_tables import gains_table, markdown, virtual
from eightpost.workers.process import usable_processors


def main() -> None:
    """Run the benchmark and print its tables."""
    options, started = _options(), perf_counter()
    found = []
    for one in results(_bench(options)):
        found.append(one)
        print(_line(one), file=sys.stderr, flush=True)
    text = f"{markdown(found)}\n\n{gains_table(virtual(found))}\n\nThe benchmark took {perf_counter() - started:.0f} s."
    print(text)
    if options.markdown:
        options.markdown.write_text(text + "\n", encoding="utf-8")
    if options.json:
        options.json.write_text(json.dumps([one.row() for one in found], indent=1) + "\n", encoding="utf-8")
    if options.picture:
        draw(found, options.picture)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one pair of draws of 10.5 s: under four minutes")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--markdown", type=Path, help="also write the printed text to this file")
    parser.add_argument("--picture", type=Path, help="draw the errors of the configurations into this file")
    parser.add_argument(
        "--configurations", default=",".join(map(str, range(1, 13))), help="configurations, separated by commas"
    )
    parser.add_argument("--laws", default=",".join((*LAWS, BOUC_WEN)), help="laws, separated by commas")
    parser.add_argument(
        "--recipe", choices=("joint", "boggs"), default="joint", help="recipe of the fits; boggs: that of 3.3"
    )
    parser.add_argument(
        "--processes", type=int, default=min(2, usable_processors()), help="number of parallel processes; default 2"
    )
    return parser.parse_args()


def _bench(options: argparse.Namespace) -> Bench:
    numbers = tuple(int(number) for number in options.configurations.split(",") if number)
    return Bench(numbers, tuple(options.laws.split(",")), options.quick, options.recipe, options.processes)


def _line(one: Result) -> str:
    if isinstance(one, FailedFit):
        return f"{one.case.record}, {one.law}: not fitted: {one.reason}"
    return f"{one.case.record}, {one.law}: {one.fit_percent:.3g} %, held out {one.validation_percent:.3g} %"


if __name__ == "__main__":
    main()
