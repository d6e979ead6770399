"""Time and memory of studies of many setups.

    python -m benchmarks.scale [--builds 7,12,18] [--stop SECONDS] [--workers N] [--json FILE]

The shipped study (benchmarks/study.py) with more builds: the seven of its bank, and the same shocks with scaled
forces. N builds at four corners are N^4 setups: 2401, 20736 and 104976. `--stop` is the length of the lap [s]; what
depends on the number of setups is the same as for a whole lap, only the runs are shorter. Every size runs in a process
of its own, phase by phase:

    run          choice of the coupling, all setups, and the table
    open         the table again, its ranking and its verdict
    certainty    how sure the choice is, with the runs for the effects of uncertain parameters
    page         page, CSV table, workbook and figures

Prints Markdown: wall time and largest resident memory of the process in each phase, and that of its largest worker.
--json writes rows {setups, phase, seconds, megabytes, worker_megabytes}. Memory is read from the kernel (Linux only).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil

from benchmarks.study import shipped_study
from cosim.study import Build, Study, StudyResult
from cosim.study.running.sweep import run_study
from cosim.study.running.workers import ProcessWorkers

#: Number of builds of the shipped bank, and factors of the compression and rebound forces of the others.
SHIPPED, FACTORS = 7, ((0.85, 1.15), (1.2, 0.9))

#: Interval at which the memory of the workers is read [s].
LOOK = 0.1

MEGABYTE = 2.0**20

Row = dict[str, Any]


def main() -> None:
    """Measure every size in a process of its own, and print the table."""
    options = _options()
    if options.child:
        rows = measured(options.builds[0], options.stop, options.workers, Path(options.child))
        Path(options.child, "rows.json").write_text(json.dumps(rows), encoding="utf-8")
        return
    found: list[Row] = []
    for builds in options.builds:
        with tempfile.TemporaryDirectory() as folder:
            own = ["--builds", str(builds), "--stop", str(options.stop), "--workers", str(options.workers)]
            environment = {**os.environ, "ARROW_DEFAULT_MEMORY_POOL": "system"}  # as `eightpost study` does
            command = [sys.executable, "-m", "benchmarks.scale", *own, "--child", folder]
            subprocess.run(command, env=environment, check=True)
            found += json.loads(Path(folder, "rows.json").read_text(encoding="utf-8"))
    print(markdown(found))
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def many_setups(folder: Path, builds: int, stop: float) -> Study:
    """Return the shipped study with a number of builds at every corner, on the first seconds of the lap."""
    study = shipped_study(folder, builds=min(builds, SHIPPED))
    bank = dict(study.bank)
    for compression, rebound in FACTORS:
        own = {"compression_scale": compression, "rebound_scale": rebound}
        bank |= {f"{name} x{compression:g}": Build(build.fmu, own) for name, build in study.bank.items()}
    names = tuple(bank)[:builds]
    return replace(
        study,
        bank={name: bank[name] for name in names},
        corners=dict.fromkeys(study.corners, names),
        drives=(replace(study.drives[0], stop=stop),),
        settling=min(study.settling, 0.5 * stop),
        measures=tuple(m for m in study.measures if not m.section),
    )


def measured(builds: int, stop: float, workers: int, folder: Path) -> list[Row]:
    """Run the phases of a study and return their costs."""
    from rich.console import Console  # noqa: PLC0415 -- workers import this file and do not need these

    from cosim.study.folder import chosen_so_far, page_of  # noqa: PLC0415
    from cosim.study.verdict import study_verdict  # noqa: PLC0415
    from eightpost.app.certainty import assess  # noqa: PLC0415

    study, out, rows = many_setups(folder, builds, stop), folder / "out", list[Row]()
    count = len(study.space)
    pool = ProcessWorkers(workers)

    def phase(name: str, work: Callable[[], Any]) -> Any:
        with watched(count, name) as row:
            found = work()
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
        return found

    try:
        phase("run", lambda: run_study(study, out, pool) and None)
        result: StudyResult = phase("open", lambda: _opened(out, study_verdict))
        phase("certainty", lambda: assess(Console(file=sys.stderr), result, out, pool) and None)
        phase("page", lambda: page_of(result, out, chosen_so_far(result, out)))
    finally:
        pool.close(wait=True)
    return rows


def _opened(folder: Path, study_verdict: Callable[[StudyResult], Any]) -> StudyResult:
    result = StudyResult.load(folder / "results.parquet")
    result.ranking()
    study_verdict(result)
    return result


@contextmanager
def watched(setups: int, phase: str) -> Iterator[Row]:
    """Yield a row that contains the costs of the block after its end."""
    row: Row = {"setups": setups, "phase": phase}
    largest, ended = [0], threading.Event()
    thread = threading.Thread(target=_watch, args=(largest, ended), daemon=True)
    thread.start()
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # resets the largest resident memory
    began = time.perf_counter()
    try:
        yield row
    finally:
        row["seconds"] = round(time.perf_counter() - began, 2)
        ended.set()
        thread.join()
        row |= {"megabytes": round(_peak()), "worker_megabytes": round(largest[0] / MEGABYTE)}


def _peak() -> float:
    """Return the largest resident memory of this process since it was reset [MB]."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) * 1024 / MEGABYTE for line in lines if line.startswith("VmHWM"))


def _watch(largest: list[int], ended: threading.Event) -> None:
    while not ended.wait(LOOK):
        for child in psutil.Process().children():
            try:
                largest[0] = max(largest[0], child.memory_info().rss)
            except psutil.NoSuchProcess:
                continue


def markdown(rows: list[Row]) -> str:
    """Return the rows as a table."""
    head = "| setups | phase | wall [s] | memory [MB] | largest worker [MB] |"
    cells = (
        f"| {r['setups']} | {r['phase']} | {r['seconds']:.1f} | {r['megabytes']} | {r['worker_megabytes']} |"
        for r in rows
    )
    return "\n".join([head, f"|{'---|' * 5}", *cells])


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--builds", type=_counts, default=(7, 12, 18), help="numbers of builds, separated by commas")
    parser.add_argument("--stop", type=float, default=4.0, help="length of the lap [s]")
    parser.add_argument("--workers", type=int, default=2, help="number of worker processes")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    return parser.parse_args()


def _counts(text: str) -> tuple[int, ...]:
    return tuple(int(count) for count in text.split(","))


if __name__ == "__main__":
    main()
