"""Measured records: what is fitted of each damper, and what is left out."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.verdicts.cases import Case
from eightpost.rig import DynoTest, read_dyno_test

#: Name of the rest of a record of which two thirds are fitted.
LAST_THIRD = "last third"

#: Longest part of a record that is used [s].
LONGEST = 18.0


def measured(folder: Path) -> Iterator[Case]:
    """Yield the cases of a folder, in which each folder has the runs (CSV) of one damper at one setting.

    Of each run the last third is left out once. Each run is fitted alone and judged on the others, and each is left out
    of a fit to all others.
    """
    for damper in sorted(path for path in folder.iterdir() if path.is_dir()):
        runs = {path.stem: _short(read_dyno_test(path)) for path in sorted(damper.glob("*.csv"))}
        for name, run in runs.items():
            end = run.series.duration
            thirds = [part(run, *ends) for ends in ((0.0, end / 1.5), (end / 1.5, end))]
            others = {other: one for other, one in runs.items() if other != name}
            yield Case(
                f"{name}, its first two thirds", (thirds[0],), {LAST_THIRD: thirds[1]} | others, is_measured=True
            )
            if len(others) > 1:
                yield Case(f"{damper.name}, all but {name}", tuple(others.values()), {name: run}, is_measured=True)


def _short(run: DynoTest) -> DynoTest:
    return part(run, 0.0, min(run.series.duration, LONGEST))


def part(run: DynoTest, start: float, stop: float) -> DynoTest:
    """Return the seconds from `start` to `stop` of a run."""
    first = float(run.series.time[0])
    return DynoTest(run.series.window(first + start, first + stop))


def whole(run: DynoTest) -> tuple[float, float]:
    """Return start and end [s] of a run; its resampling may shorten it by a sample."""
    return 0.0, run.series.duration - 2.0 / run.series.sample_rate
