"""Runs of many systems in several processes, with rows stored in a file as they are computed."""

from __future__ import annotations

import json
import os
import traceback
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchmarks.honesty.cars import build_fmus
from benchmarks.honesty.cases import VERSION, draw_case
from benchmarks.honesty.runs import compare, schemes_of

Row = dict[str, Any]

_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def run_campaign(
    seeds: Iterable[int], which: str, *, workers: int = 2, keep: Path | None = None, quiet: bool = False
) -> list[Row]:
    """Return the rows of all seeds; those that are in the file already are not computed again.

    Args:
        seeds: Seeds, one per system.
        which: Choice of schemes; see `runs.schemes_of`.
        workers: Number of processes.
        keep: File for the rows, one JSON document per line; rows are appended as they are computed.
        quiet: Whether to hide the progress bar.
    """
    wanted = list(dict.fromkeys(seeds))
    rows = [row for row in (read_rows(keep) if keep and keep.exists() else []) if row["seed"] in set(wanted)]
    done = {(row["seed"], row["which"]) for row in rows}
    left = [seed for seed in wanted if (seed, which) not in done]
    folder = build_fmus(name for seed in left for name in draw_case(seed).fmu_names.values())
    for found in _computed(left, which, folder, workers, quiet):
        rows += found
        if keep:
            _append(keep, found)
    return sorted((row for row in rows if row["which"] == which), key=lambda row: (row["seed"], row["scheme"]))


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a campaign's file; rows of other versions of the random systems are omitted."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [row for row in map(json.loads, lines) if row["version"] == VERSION]


def run_case(seed: int, which: str, folder: Path) -> list[Row]:
    """Return the rows of one system; a failure of the campaign itself is a row too."""
    case = draw_case(seed)
    about = {"version": VERSION, "which": which, "seed": seed}
    try:
        return [about | row for row in compare(case, folder, schemes_of(seed, which))]
    except Exception:
        told = traceback.format_exc(limit=-3)
        return [about | {"scheme": which, "case": case.description, "failed": told}]


def _append(path: Path, rows: list[Row]) -> None:
    with path.open("a", encoding="utf-8") as stream:
        stream.writelines(json.dumps(row) + "\n" for row in rows)


def _computed(seeds: list[int], which: str, folder: Path, workers: int, quiet: bool) -> Iterator[list[Row]]:
    """Yield the rows of each system when it is finished."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, disable=quiet) as progress:
        task = progress.add_task("systems", total=len(seeds))
        for found in _in_processes(seeds, which, folder, workers):
            progress.advance(task)
            yield found


def _in_processes(seeds: list[int], which: str, folder: Path, workers: int) -> Iterator[list[Row]]:
    if workers <= 1 or len(seeds) <= 1:
        yield from (run_case(seed, which, folder) for seed in seeds)
        return
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # the processes inherit it
    with ProcessPoolExecutor(min(workers, len(seeds)), mp_context=get_context("spawn")) as pool:
        futures: list[Future[list[Row]]] = [pool.submit(run_case, seed, which, folder) for seed in seeds]
        for future in as_completed(futures):
            yield future.result()
