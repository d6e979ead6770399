"""Passes on the virtual rig."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from eightpost.drivefile.folder import IterationFolder
from eightpost.drivefile.iteration import Outcome, Status
from eightpost.rig.post.bench import Bench
from eightpost.signals import Drivefile
from eightpost.signals.formats import read_series

#: Name of the rig's record in the folder of a pass.
RECORD = "rig.parquet"


def play(folder: IterationFolder, bench: Bench, shocks: Sequence[str]) -> Path:
    """Play the waiting drive file on the virtual rig, and return the file of the rig's record.

    Each pass is another run with its own noise and drift.

    Args:
        folder: Iteration with a waiting drive file.
        bench: Car on the virtual rig.
        shocks: Name of the shock at each corner.
    """
    number = folder.waiting or folder.played + 1
    place = folder.pass_path(number)
    test = bench.record(Drivefile(read_series(place / "drive.parquet")), shocks, f"drive file, pass {number}", number)
    test.write(place / RECORD)
    return place / RECORD


def iterate(
    folder: IterationFolder,
    bench: Bench,
    shocks: Sequence[str],
    passes: int,
    report: Callable[[Outcome], None] | None = None,
) -> Outcome:
    """Run passes on the virtual rig until there are `passes`, or until the iteration diverged.

    Args:
        folder: Iteration, which may have passes.
        bench: Car on the virtual rig.
        shocks: Name of the shock at each corner.
        passes: Number of passes at the end, including those before.
        report: Function that receives the state after each pass; default none.
    """
    outcome = folder.write_next()
    while folder.played < passes and outcome.status is not Status.DIVERGED:
        folder.add_record(play(folder, bench, shocks))
        outcome = folder.write_next()
        if report is not None:
            report(outcome)
    return outcome
