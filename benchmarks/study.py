"""Cost and coupling accuracy of the setup study: 2401 setups of seven builds on the shipped car.

    python benchmarks/study.py [--quick] [--workers NUMBERS] [--json FILE]

Seven builds (examples/bank) at four corners, a 33 s lap, 26 measures, accuracy 0.2 %; with --quick three builds: 81
setups. Prints Markdown; --json writes rows {path, setups, seconds, workers, coupling_error_percent, checked_percent,
cpu_seconds}. `seconds` is the wall time of everything except building FMUs: starting the workers, choosing the
coupling, running, measuring, writing the table. `coupling_error_percent` is the largest estimate in the table;
`checked_percent` is the largest error of five random setups against runs at an eighth of the step, over bond velocities
and forces and tire forces, in percent of each signal's standard deviation. `cpu_seconds` is the workers' processor
time. With --workers 1,2 a second table shows the parallel efficiency: time of one worker divided by the time of all
times their number. All times are of
this machine and this run.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.session.result import difference
from cosim.study import Study, StudyResult
from cosim.study.running.evaluator import Evaluator, coupling_of
from cosim.study.running.sweep import run_study
from cosim.study.running.workers import ProcessWorkers
from cosim.study.study_file import read_study, source_files
from eightpost.workers.process import usable_processors

ROOT = Path(__file__).resolve().parents[1]

#: Length of the lap [s], and the seed of its road.
LAP, SEED = 33.0, 11

#: Number of random setups that are checked, and their seed.
CHECKED, DRAW = 5, 7

Row = dict[str, Any]


def main() -> None:
    """Measure and print the tables."""
    options = _options()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study = shipped_study(folder, builds=3 if options.quick else 7)
        found = [measure(study, folder / f"{count}", count) for count in options.workers]
        print(markdown(found))
        if len(found) > 1:
            print(f"\n{efficiency(found)}")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def shipped_study(folder: Path, *, builds: int) -> Study:
    """Return examples/study.toml on a whole lap with the first builds of its bank; its FMUs are built in the folder."""
    # Imported here, because workers import this file and do not need these.
    from builder.build import build  # noqa: PLC0415
    from eightpost.virtual.drivefiles import track_drivefile  # noqa: PLC0415

    path, lap = ROOT / "examples" / "study.toml", folder / "lap.parquet"
    track_drivefile(SEED, duration=LAP, rate=500.0).write(lap)
    fmus = {Path(item.source): item.path for item in build(source_files(path), folder / "fmus")}
    study = read_study(path, lambda source: fmus[source])
    names = tuple(study.bank)[:builds]
    return replace(
        study,
        bank={name: study.bank[name] for name in names},
        corners=dict.fromkeys(study.corners, names),
        baseline=dict.fromkeys(study.corners, names[-1]),
        drives=(replace(study.drives[0], file=lap, stop=LAP),),
    )


def measure(study: Study, folder: Path, count: int) -> Row:
    """Run the study with a number of workers and return its costs and errors."""
    used, began = ended_processes(), time.perf_counter()
    workers = ProcessWorkers(count)
    try:
        result = run_study(study, folder, workers)
        seconds = time.perf_counter() - began
    finally:
        workers.close(wait=True)
    errors = result.table["coupling_error_percent"].to_numpy()
    return {
        "path": "machine" if coupling_of(result).machine else "fmu",
        "setups": len(result),
        "seconds": seconds,
        "workers": count,
        "coupling_error_percent": float(np.max(errors)),
        "checked_percent": checked(result),
        "cpu_seconds": ended_processes() - used,
    }


def checked(result: StudyResult) -> float:
    """Return the largest coupling error of random setups against runs at an eighth of the step [%]."""
    evaluator, coupling, drive = Evaluator(result.study), coupling_of(result), result.study.drives[0]
    worst = 0.0
    for index in np.random.default_rng(DRAW).choice(result.setups, CHECKED, replace=False):
        setup = result.study.space.setup(int(index))
        names = evaluator.decisive(setup)
        fine = evaluator.run(setup, drive, replace(coupling, step=coupling.step / 8.0), extra=names)
        apart = difference(evaluator.run(setup, drive, coupling, extra=names).settled(), fine.settled())
        worst = max(worst, *(apart[name] for name in names))
    return worst


def markdown(rows: list[Row]) -> str:
    """Return the rows as a table."""
    head = "| path | setups | workers | wall [s] | processor time [s] | stated error [%] | checked error [%] |"
    cells = (
        f"| {r['path']} | {r['setups']} | {r['workers']} | {r['seconds']:.1f} | {r['cpu_seconds']:.1f} | "
        f"{r['coupling_error_percent']:.3f} | {r['checked_percent']:.3f} |"
        for r in rows
    )
    return "\n".join([head, f"|{'---|' * 7}", *cells])


def efficiency(rows: list[Row]) -> str:
    """Return a table of the parallel efficiency relative to the first row."""
    first = rows[0]
    head = "| workers | wall [s] | speed-up | parallel efficiency |"
    cells = (
        f"| {r['workers']} | {r['seconds']:.1f} | {first['seconds'] / r['seconds']:.2f} | "
        f"{first['seconds'] * first['workers'] / (r['seconds'] * r['workers']):.0%} |"
        for r in rows
    )
    return "\n".join([head, f"|{'---|' * 4}", *cells])


def ended_processes() -> float:
    """Return the processor time of worker processes that have ended [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three builds: 81 setups")
    parser.add_argument(
        "--workers", type=_counts, default=(usable_processors(),), help="numbers of workers, separated by commas: 1,2"
    )
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    return parser.parse_args()


def _counts(text: str) -> tuple[int, ...]:
    return tuple(int(count) for count in text.split(","))


if __name__ == "__main__":
    main()
