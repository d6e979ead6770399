"""Runs of one engine in a separate process: some engines write to the standard output, some end the program.

    python -m benchmarks.engines.worker ENGINE JOBS_JSON

Writes recording.npz, or diverged.txt, to each job's work folder.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

from benchmarks.engines.job import Diverged, Job


def main() -> None:
    """Run the jobs one after the other."""
    name, text = sys.argv[1:]
    run = importlib.import_module(f"benchmarks.engines.{name}").run
    for told in json.loads(text):
        job = Job(**told)
        try:
            recordings = [run(job) for _ in range(job.repeats)]
        except Diverged as error:
            (Path(job.work) / "diverged.txt").write_text(str(error), encoding="utf-8")
            continue
        min(recordings, key=lambda one: one.seconds / one.steps).save(Path(job.work) / "recording.npz")


if __name__ == "__main__":
    main()
