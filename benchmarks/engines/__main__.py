"""Comparison of engines: cost and error of each way of coupling the same FMUs.

    python -m benchmarks.engines [--quick] [--json FILE] [--engines NAMES] [--damping full]

One vehicle and four shocks (benchmarks/case.py), 14 recorded outputs, 30 s of the demo's track; with --quick 5 s and
fewer rates. Engines are cosim.run, a loop over fmpy, and a loop in C with nothing around it, the lower limit. The
reference integrates the same equations as one system with scipy (tests/monolithic.py). Costs are microseconds of
processor time per coupling step: the time of each row's own steps, without loading, divided by their number, the
minimum of several passes. Prints Markdown; --json writes rows {engine, scheme, damping, rate_hz, us_per_step,
error_velocity_percent, error_tire_force_percent}: percent of the reference signal's standard deviation, worst corner,
without the first second; null if it diverged. Compare times within one table only.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from math import inf
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.case import Case, build_fmus, fitted_law, make_case, split_law, track
from benchmarks.engines import c_loop, fmpy_loop, runs
from benchmarks.table import markdown

RATES, QUICK_RATES = (125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0), (125.0, 1000.0, 4000.0)
PASSES = 3

#: Engines beside cosim.run, by name.
PEERS: dict[str, ModuleType] = {"fmpy": fmpy_loop, "C loop": c_loop}


def main() -> None:
    """Run the table."""
    options = _options()
    best: dict[tuple[Any, ...], runs.Row] = {}
    with tempfile.TemporaryDirectory() as name:
        cases = [(one, *_prepared(Path(name) / one, one, options.stop)) for one in options.damping.split(",")]
        for _ in range(PASSES):  # the machine's speed varies: every engine then also runs while it is fast
            for found in (row for damping, case, folder in cases for row in _rows(options, damping, case, folder)):
                print(markdown([found]).splitlines()[-1], file=sys.stderr)
                label = tuple(found[part] for part in ("engine", "scheme", "damping", "rate_hz"))
                if label not in best or _cost(found) < _cost(best[label]):
                    best[label] = found
    print(markdown(list(best.values())))
    if options.json:
        options.json.write_text(json.dumps(list(best.values()), indent=1) + "\n", encoding="utf-8")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="5 s and three rates")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--engines", default=",".join([runs.ENGINE, *PEERS]), help="engines, separated by commas")
    parser.add_argument("--damping", default="full,split", help="where the damping is: in the shocks (full), or split")
    parser.add_argument("--stop", type=float, help="duration [s], at least 1.1")
    options = parser.parse_args()
    options.rates = QUICK_RATES if options.quick else RATES
    options.stop = options.stop or (5.0 if options.quick else 30.0)
    options.engines = options.engines.split(",")
    return options


def _prepared(folder: Path, damping: str, stop: float) -> tuple[Case, Path]:
    """Solve the reference, and build the FMUs."""
    law, port_damping = (fitted_law(), 0.0) if damping == "full" else split_law(fitted_law())
    case = make_case(law, track(), stop, record_step=runs.RECORD_STEP, port_damping=port_damping)
    build_fmus(case.law, folder, port_damping=port_damping)
    return case, folder


def _cost(found: runs.Row) -> float:
    return inf if found["us_per_step"] is None else float(found["us_per_step"])


def _rows(options: argparse.Namespace, damping: str, case: Case, folder: Path) -> Iterator[runs.Row]:
    if runs.ENGINE in options.engines:
        yield from _our_rows(options.rates, damping, case, folder)
    for name, engine in PEERS.items():
        for scheme in engine.SCHEMES if name in options.engines else ():
            for rate in options.rates:
                with tempfile.TemporaryDirectory() as work:
                    job = runs.Job(folder, case.drive, scheme, rate, case.stop, Path(work))
                    yield runs.row(case, (name, scheme, damping, rate), runs.attempt(partial(engine.run, job)))


def _our_rows(rates: tuple[float, ...], damping: str, case: Case, folder: Path) -> Iterator[runs.Row]:
    asked = runs.load(folder), case.drive
    runs.run_fixed(*asked, 0.04, runs.FIXED["jacobi, held"], 1000.0, repeats=1)  # compiles the loops, or loads them
    for scheme, algorithm in runs.FIXED.items():
        for rate in rates:
            one = partial(runs.run_fixed, *asked, case.stop, algorithm, rate)
            yield runs.row(case, (runs.ENGINE, scheme, damping, rate), runs.attempt(one))
    for scheme, adaptive in runs.ADAPTIVE.items():
        one = partial(runs.run_adaptive, *asked, case.stop, adaptive)
        yield runs.row(case, (runs.ENGINE, scheme, damping, None), runs.attempt(one))
    label = (runs.ENGINE, "default", damping, None)
    yield runs.row(case, label, runs.attempt(partial(runs.run_default, *asked, case.stop)))


if __name__ == "__main__":
    main()
