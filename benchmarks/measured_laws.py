"""Benchmark of the laws on measured records: how much worse is each law than the best one in hindsight?

    EIGHTPOST_DATA=... python -m benchmarks.measured_laws [--rows FILE]

Each record is held out by time: its first or second half, its first or last third. Where a setting has several runs,
each is predicted from each other one: those of the same motion, and those of another speed. The latter are counted
alone, and so are held-out parts that have a rest while the fitted part has none, because the motion does not determine
the force there. Errors are those of a free simulation in percent of the standard deviation of the held-out force,
between runs without their mean, because the zeros of the load cells differ. The regret of a law is its error over the
smallest one of all laws, minus 1.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from itertools import permutations
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from benchmarks.shock_records import Case, Segment, measured_runs
from benchmarks.shock_rows import FitErrors, attempt
from benchmarks.shock_tables import grid
from benchmarks.table import number
from eightpost.ident.shock.law_fit import DEFAULT_LAW
from eightpost.ident.shock.runs import prepare_runs
from eightpost.rig import DynoTest
from eightpost.shock import LAWS, law_title

#: Kinds of splits.
TIME, RUN, REST, SPEED = "other time", "other run, same motion", "other time, with a rest", "other run, other speed"

#: Fitted and held-out part of a record as shares of its length.
PARTS = {
    "first half, second": ((0.0, 0.5), (0.5, 1.0)),
    "second half, first": ((0.5, 1.0), (0.0, 0.5)),
    "first two thirds, last": ((0.0, 2.0 / 3.0), (2.0 / 3.0, 1.0)),
    "last two thirds, first": ((1.0 / 3.0, 1.0), (0.0, 1.0 / 3.0)),
}

#: Starts of the names of the runs of one setting.
SETTINGS = ("labcontrol: ", "ohlins: 1_1_18_18")

#: Share of the peak speed below which a shock is at rest, and share of the time from which a part has a rest.
STILL, RESTING = 0.02, 0.05

#: Regret up to which a law is as good as the best one.
CLOSE = 0.05

#: A row: kind and name of the split, and the error of each law [%]; None if it could not be fitted.
Row = tuple[str, str, dict[str, float | None]]


def splits(folder: Path) -> Iterator[tuple[str, Case]]:
    """Yield kind and case of every split of the measured records of a folder."""
    runs = dict(measured_runs(folder))
    for name, run in runs.items():
        for part, shares in PARTS.items():
            kept, left = ((start * run.series.duration, stop * run.series.duration) for start, stop in shares)
            kind = REST if rests(run, left) and not rests(run, kept) else TIME
            yield kind, Case(f"{name}, {part}", (run,), run, kept, left)
    for setting in SETTINGS:
        for one, other in permutations([name for name in runs if name.startswith(setting)], 2):
            fitted, held = runs[one], runs[other]
            kind = RUN if prepare_runs([fitted, held]).has_repeated_motions else SPEED
            kept, left = ((0.0, run.series.duration) for run in (fitted, held))
            yield kind, Case(f"{one}, {other.removeprefix(setting)}", (fitted,), held, kept, left, about_mean=True)


def rests(run: DynoTest, ends: Segment) -> bool:
    """Return whether the shock is at rest for more than moments in a part of a run."""
    speed = np.abs(run.series["velocity"])
    here = (run.series.time >= ends[0]) & (run.series.time < ends[1])
    return bool(np.mean(speed[here] <= STILL * speed.max()) > RESTING)


def rows(folder: Path) -> Iterator[Row]:
    """Fit every law to every split."""
    for kind, case in splits(folder):
        found = {law: attempt(case, law, "joint") for law in LAWS}
        errors = {law: one.validation_percent if isinstance(one, FitErrors) else None for law, one in found.items()}
        yield kind, case.record, errors


def regrets(found: Sequence[Row], law: str) -> np.ndarray:
    """Return the regret of a law in each split [1]; infinite where it could not be fitted."""
    errors = np.array([[np.inf if error is None else error for error in row[-1].values()] for row in found])
    return np.asarray(errors[:, list(LAWS).index(law)] / errors.min(axis=1) - 1.0)


def summary(found: Sequence[Row]) -> str:
    """Return the regret of each law in each kind of split as Markdown."""
    heads = ("held out", "law", "median error [%]", "best within 5 %", "mean regret [%]", "median", "worst")
    lines = []
    for kind in (TIME, RUN, REST, SPEED):
        here = [row for row in found if row[0] == kind]
        for law in LAWS:
            regret = regrets(here, law)
            errors = [np.inf if (error := row[-1][law]) is None else error for row in here]
            figures = [number(100.0 * float(figure(regret))) for figure in (np.mean, np.median, np.max)]
            title = law_title(law) + (" (default)" if law == DEFAULT_LAW["joint"] else "")
            close = f"{int(np.sum(regret <= CLOSE))} of {len(here)}"
            lines.append([kind, title, number(float(np.median(errors))), close, *figures])
    return grid(heads, lines)


def details(found: Sequence[Row]) -> str:
    """Return the errors of each split as Markdown, the smallest one in bold."""
    lines = []
    for kind, name, errors in found:
        smallest = min(error for error in errors.values() if error is not None)
        cells = [number(error) if error != smallest else f"**{number(error)}**" for error in errors.values()]
        lines.append([kind, name, *cells])
    return grid(("held out", "fitted, held out", *map(law_title, LAWS)), lines)


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=Path, help="also write the errors to this file (JSON)")
    options = parser.parse_args()
    found = []
    for row in rows(Path(os.environ["EIGHTPOST_DATA"])):
        found.append(row)
        print(row, file=sys.stderr, flush=True)
    print(f"{summary(found)}\n\n{details(found)}")
    if options.rows:
        options.rows.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
