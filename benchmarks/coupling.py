"""Comparison of engines: cost and error of each way of coupling the same FMUs.

    python benchmarks/coupling.py [--quick] [--json FILE] [--markdown FILE] [--picture FILE] [--engines NAMES]

One vehicle and four shocks (benchmarks/case.py), 14 recorded outputs, 30 s of the demo's track; with --quick 5 s, fewer
rates, and no large systems. The reference integrates the same equations as one system with scipy (tests/monolithic.py).
Costs are microseconds of processor time per coupling step: the time of each row's own steps, without loading, divided
by their number. The table is printed as Markdown; --json writes rows {engine, scheme, damping, rate_hz, us_per_step,
error_velocity_percent, error_tire_force_percent}: percent of the reference signal's standard deviation, worst corner,
without the first second; null if it diverged. Times depend on the machine and the run: compare them within one table
only.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.case import build_fmus, make_case
from benchmarks.engines import ours
from benchmarks.picture import draw
from benchmarks.rows import DAMPINGS, QUICK_RATES, RATES, Bench, measure, prepare, rows
from benchmarks.scaling import table as scaling_table
from benchmarks.summary import summary
from benchmarks.table import markdown

__all__ = ["build_fmus", "main", "make_case", "measure"]


def main() -> None:
    """Run the table."""
    options = _options()
    with tempfile.TemporaryDirectory() as name:
        bench = Bench(
            Path(name),
            stop=options.stop or (5.0 if options.quick else 30.0),
            rates=options.rates or (QUICK_RATES if options.quick else RATES),
            engines=tuple(options.engines.split(",")) if options.engines else (),
            dampings=tuple(options.damping.split(",")),
            passes=2 if options.quick else 3,
            repeats=1 if options.quick else 3,
            quick=options.quick,
        )
        found = rows(bench, prepare(bench), lambda row: print(markdown([row]).splitlines()[-1], file=sys.stderr))
        text = _text(bench, found, large=not options.quick and bench.wants(ours.ENGINE))
    print(text)
    if options.markdown:
        options.markdown.write_text(text + "\n", encoding="utf-8")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.picture:
        draw(found, options.picture)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="5 s and three rates: under two minutes")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--markdown", type=Path, help="write the printed text to this file too")
    parser.add_argument("--picture", type=Path, help="plot error against cost into this file")
    parser.add_argument("--engines", help="engines to run, separated by commas: eightpost,fmpy,libcosim")
    parser.add_argument("--damping", default=",".join(DAMPINGS), help="damping case: full, split, or both (default)")
    parser.add_argument("--rates", type=_rates, help="coupling rates [Hz], multiples of 125, separated by commas")
    parser.add_argument("--stop", type=float, help="duration [s], at least 1.1")
    return parser.parse_args()


def _rates(text: str) -> tuple[float, ...]:
    return tuple(float(rate) for rate in text.split(","))


def _text(bench: Bench, found: list[dict[str, Any]], *, large: bool) -> str:
    parts = [markdown(found), "\n".join(f"- {note}" for note in bench.notes()), summary(found)]
    if large:
        parts.append("Many vehicles in one system (gauss-seidel, 1 kHz):\n")
        parts[-1] += "\n" + "\n".join(scaling_table(bench.folder / bench.dampings[0], 2.0))
    return "\n\n".join(part for part in parts if part)


if __name__ == "__main__":
    main()
