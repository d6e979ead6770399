"""Benchmark of the verdicts of shock fits: what is the error on records that were left out, for each verdict?

    python -m benchmarks.verdicts SET --rows FILE [--count 40] [--records FOLDER]

SET is `tune` (the verdict's thresholds were chosen with it), `check`, or `final` (kinds of dampers that no rule was
chosen with): virtual dampers of several kinds, tested in several ways, by dynamometers that differ in rate, filter,
noise and channels, every fifth with a fault. `measured`: the records in the folder --records (see `cases.measured`).
`laws`: no verdicts, but the regret of each law on the records in --records (see `laws.splits`).

Errors are in percent of the standard deviation of the force of the record that was left out, without their mean if it
is another run of a measured damper, whose load cell may have another zero. Such a record is within the range of the fit
if its median stroke is within the stated lengths, peak speeds and frequencies, and if its extremes of velocity,
displacement and temperature are within the fitted ones, by 10 % (2 K). Rows that FILE has are not computed again.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from benchmarks.table import markdown, number, parser_of
from benchmarks.verdicts import laws
from benchmarks.verdicts.cases import LAST_THIRD, Case, case, measured, percent, whole
from benchmarks.verdicts.dampers import CHECK, FINAL, TUNE
from eightpost.ident import ShockFit, fit_shock
from eightpost.ident.shock.runs import StrokeRange, prepare, strokes
from eightpost.rig import DynoTest
from eightpost.verdict import ORDER

#: Kinds of dampers and seed of each set.
SETS = {"tune": (TUNE, 101), "check": (CHECK, 202), "final": (FINAL, 303)}

#: Factor, and temperature [K], by which a left-out record may be outside the range of a fit.
BEYOND, WARMER = 1.1, 2.0

Row = dict[str, Any]


def rows_of(found: Case) -> Iterator[Row]:
    """Yield one row for each left-out record of a case; one without an error if the fit refuses the records."""
    try:
        fit = fit_shock(found.fitted)
    except ValueError as error:  # raised by laws and fits that reject the data
        yield {"case": found.name, "refused": str(error)}
        return
    common: Row = {"case": found.name, "grade": fit.verdict.grade.value, "residual": fit.percent}
    common["rules"] = [reason.rule for reason in fit.verdict.decisive]
    common["held_out"] = None if fit.held_out is None else fit.held_out.percent
    for name, record in found.held_out.items():
        error = percent(fit.shock, record, about_mean=found.is_measured and name != LAST_THIRD)
        within = _is_within(fit, found.fitted, record)
        yield common | {"held": name, "error": error, "within": within}


def _is_within(fit: ShockFit, fitted: Sequence[DynoTest], record: DynoTest) -> bool:
    tested = StrokeRange.of([prepare(one) for one in fitted])
    held = prepare(record, segment=whole(record))
    stroke, speed, duration = strokes(held.record["velocity"][held.inside], held.step)
    each = stroke, speed, 0.5 / duration
    values = (np.quantile(one, 0.5, weights=duration, method="inverted_cdf") for one in each)
    limits = (tested.stroke, tested.speed, tested.frequency)
    typical = (low / BEYOND <= value <= BEYOND * high for value, (low, high) in zip(values, limits, strict=True))
    known, velocity = fit.shock.conditions, held.record["velocity"][held.inside]
    low, high = known["velocity_range [m/s]"]
    is_slower = BEYOND * low <= velocity.min() and velocity.max() <= BEYOND * high
    is_shorter = is_cold = True
    if "displacement_range [m]" in known and "displacement" in held.record:
        longest = BEYOND * float(np.ptp(known["displacement_range [m]"]))
        is_shorter = float(np.ptp(held.record["displacement"][held.inside])) <= longest
    if "temperature_range [K]" in known and held.temperature is not None:
        cold, warm = known["temperature_range [K]"]
        is_cold = cold - WARMER <= held.temperature.min() and held.temperature.max() <= warm + WARMER
    return bool(all(typical) and is_slower and is_shorter and is_cold)


def report(rows: Sequence[Row]) -> str:
    """Return the tables as Markdown: errors for each verdict, good fits that are green."""
    judged = [row for row in rows if "error" in row]
    heads = ("verdict", "left-out records", "fits", "worst", "95 %", "90 %", "median", "above 5 %", "above 10 %")
    lines = []
    for grade in reversed(ORDER):
        for is_within, where in ((True, "within the range"), (False, "outside")):
            here = [row for row in judged if row["grade"] == grade and row["within"] is is_within]
            lines += [[grade.value, where, *_spread(here)]] if here else []
    good = _good_fits(judged)
    green = sum(grade == ORDER[-1] for grade in good.values())
    text = markdown(heads, lines)
    text += f"\n\nFits with at most 5 % on all records within their range: {len(good)}, of which green: {green}."
    refused = sum("refused" in row for row in rows)
    return text + (f" Refused: {refused}." if refused else "")


def _spread(rows: Sequence[Row]) -> list[str]:
    errors = np.array([row["error"] for row in rows])
    figures = [number(float(np.quantile(errors, share))) for share in (1.0, 0.95, 0.9, 0.5)]
    fits = f"{len(rows)} of {len({row['case'] for row in rows})} fits"
    return [fits, *figures, *(f"{100.0 * np.mean(errors > limit):.0f} %" for limit in (5.0, 10.0))]


def _good_fits(judged: Sequence[Row]) -> Mapping[str, str]:
    """Return the grade of each fit whose errors within its range are at most 5 %."""
    worst: dict[str, float] = {}
    for row in judged:
        if row["within"]:
            worst[row["case"]] = max(worst.get(row["case"], 0.0), row["error"])
    return {row["case"]: row["grade"] for row in judged if worst.get(row["case"], np.inf) <= 5.0}


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = parser_of(__doc__)
    parser.add_argument("set", choices=(*SETS, "measured", "laws"), help="set of dampers")
    parser.add_argument("--rows", type=Path, required=True, help="file of the rows (JSON lines), which is continued")
    parser.add_argument("--count", type=int, default=40, help="number of virtual dampers")
    parser.add_argument("--records", type=Path, help="folder of measured records, for the sets `measured` and `laws`")
    options = parser.parse_args()
    kept = options.rows.read_text(encoding="utf-8").splitlines() if options.rows.exists() else []
    rows: list[Row] = [json.loads(line) for line in kept]
    known = {row["case"] for row in rows}
    if options.set in SETS:
        begun = {name.split(":")[0] for name in known}
        cases = (case(*SETS[options.set], place) for place in range(options.count) if str(place) not in begun)
    else:
        cases = laws.splits(options.records) if options.set == "laws" else measured(options.records)
    compute, tabulate = (laws.rows_of, laws.report) if options.set == "laws" else (rows_of, report)
    for found in (one for one in cases if one.name not in known):
        new = list(compute(found))
        rows += new
        with options.rows.open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(row) + "\n" for row in new)
        print(new[0], file=sys.stderr, flush=True)
    print(tabulate(rows))


if __name__ == "__main__":
    main()
