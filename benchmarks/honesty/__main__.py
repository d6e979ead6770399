"""Comparison of the stated coupling error with the true one: random systems against an independent reference.

    python -m benchmarks.honesty [--systems 400] [--seed-base 0] [--workers 2] [--schemes default] [--json rows.jsonl]

Every system is drawn from its seed alone (benchmarks/honesty/cases.py). `--json` stores a row for each run; an
interrupted campaign resumes where it stopped.
"""

from __future__ import annotations

import json
import os
import tempfile
import time as clock
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from math import inf
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from benchmarks.honesty.cases import VERSION, build_fmus, draw_case
from benchmarks.honesty.runs import compare, schemes_of
from benchmarks.table import parser_of

Row = dict[str, Any]

#: True errors below this are not counted, because they mislead nobody [%].
SMALL = 0.02
#: Largest true error that may be accepted [%].
LARGE = 5.0
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
_UNSTATED = 1e299


@dataclass(frozen=True)
class Pair:
    """Stated and true error [%]."""

    stated: float | None  #: Stated error; None if no error is stated.
    true: float  #: Error against the reference.
    reference: float  #: Own error of the reference.

    @property
    def ratio(self) -> float:
        """Ratio of the stated to the true error."""
        return (self.stated or 0.0) / self.true if self.true and (self.stated or 0.0) < _UNSTATED else inf

    @property
    def settled(self) -> bool:
        """Whether the reference is accurate enough for a comparison."""
        return self.reference <= max(0.05 * SMALL, 0.05 * self.true)


def worst(row: Row, *, decisive: bool = True) -> Pair:
    """Return the worst stated and the worst true error of a run, each over its channels."""
    chosen = [c for c in row["channels"].values() if c["decisive"]] if decisive else list(row["channels"].values())
    stated = [c["stated"] for c in chosen if c["stated"] is not None]
    return Pair(max(stated) if stated else None, max(c["true"] for c in chosen), max(c["reference"] for c in chosen))


def met(row: Row) -> bool:
    """Return whether a run states that it is within the tolerance."""
    stated = worst(row).stated
    return bool(row["acceptable"]) and stated is not None and stated <= row["tolerance"]


def compared(rows: Sequence[Row]) -> list[Row]:
    """Return the runs that completed."""
    return [row for row in rows if row.get("channels")]


def understated(rows: Sequence[Row], below: float) -> list[Row]:
    """Return the runs whose worst stated error is below a share of the worst true one."""
    return [row for row in _stating(rows) if worst(row).true > SMALL and worst(row).ratio < below]


def overstated(rows: Sequence[Row]) -> list[Row]:
    """Return the runs whose worst stated error is above five times the worst true one."""
    return [row for row in _stating(rows) if worst(row).true > SMALL and worst(row).ratio > 5.0]


def wrongly_accepted(rows: Sequence[Row]) -> list[Row]:
    """Return the runs that are acceptable with a true error above the limit."""
    return [row for row in compared(rows) if row["acceptable"] and worst(row).true > LARGE]


def wrongly_met(rows: Sequence[Row]) -> list[Row]:
    """Return the runs within the tolerance whose true error is above twice the tolerance."""
    return [row for row in compared(rows) if met(row) and worst(row).true > 2.0 * row["tolerance"]]


def unsettled(rows: Sequence[Row]) -> list[Row]:
    """Return the runs whose reference is not accurate enough."""
    return [row for row in compared(rows) if not worst(row).settled]


def _stating(rows: Sequence[Row]) -> list[Row]:
    return [row for row in compared(rows) if worst(row).stated is not None]


def lines(rows: Sequence[Row], *, names: int = 8) -> Iterator[str]:
    """Return the printed lines for one kind of runs; `names` of the worst ones are listed."""
    ended, failed = compared(rows), [row for row in rows if row.get("failed")]
    yield (
        f"{len(rows)} runs; {len(ended)} compared, {len(rows) - len(ended) - len(failed)} ended with an error message, "
        f"{len(failed)} failed in the campaign, {len(unsettled(rows))} references not settled, "
        f"{sum(not row['repeats'] for row in ended)} not the same twice, "
        f"{sum(row.get('seconds', 0.0) for row in rows):.0f} s of processor time"
    )
    for row in failed:
        yield f"  failed: seed {row['seed']}, {row['scheme']}: {row['failed'].strip().splitlines()[-1]}"
    if ended:
        yield from _distributions(ended)
        yield from _counts(ended)
        yield from _named(ended, names)


def _distributions(rows: Sequence[Row]) -> Iterator[str]:
    yield f"\nstated / true, where the true error is above {SMALL:g} %"
    yield f"{'':24}{'n':>6}" + "".join(f"{f'{100 * q:g} %':>9}" for q in QUANTILES)
    groups: dict[str, list[Pair]] = {
        "worst decisive channel": [worst(row) for row in rows],
        "worst of all channels": [worst(row, decisive=False) for row in rows],
        "every acceleration": [
            Pair(c["stated"], c["true"], c["reference"])
            for row in rows
            for c in row["channels"].values()
            if c["unit"] == "m/s2"
        ],
    }
    for name, pairs in groups.items():
        ratios = [pair.ratio for pair in pairs if pair.stated is not None and pair.true > SMALL and pair.settled]
        if ratios:
            found = np.quantile(ratios, QUANTILES, method="nearest")
            yield f"{name:24}{len(ratios):6}" + "".join(f"{value:9.3g}" for value in found)


def _counts(rows: Sequence[Row]) -> Iterator[str]:
    refused = [row for row in rows if not row["acceptable"]]
    stating = sum(worst(row).true > SMALL for row in _stating(rows))
    tests: dict[str, tuple[list[Row], int]] = {
        "stated below half the true": (understated(rows, 0.5), stating),
        "stated below a tenth of the true": (understated(rows, 0.1), stating),
        "stated above five times the true": (overstated(rows), stating),
        f"accepted, true error above {LARGE:g} %": (wrongly_accepted(rows), len(rows)),
        "tolerance met, true error above twice the tolerance": (wrongly_met(rows), len(rows)),
        "tolerance met": ([row for row in rows if met(row)], len(rows)),
        "not acceptable": (refused, len(rows)),
        "not acceptable, true error below 2 %": ([row for row in refused if worst(row).true < 2.0], len(rows)),
    }
    yield ""
    for name, (found, among) in tests.items():
        yield f"{name:54}{len(found):6} of {among} ({100.0 * len(found) / max(among, 1):.1f} %)"


def _named(rows: Sequence[Row], count: int) -> Iterator[str]:
    worst_of: dict[str, tuple[list[Row], Callable[[Row], float]]] = {
        "most understated": (understated(rows, 0.5), lambda row: worst(row).ratio),
        "most overstated": (overstated(rows), lambda row: -worst(row).ratio),
        "accepted with large errors": (wrongly_accepted(rows), lambda row: -worst(row).true),
        "tolerance met with large errors": (wrongly_met(rows), lambda row: -worst(row).true),
    }
    for name, (found, key) in worst_of.items():
        if found and count:
            yield f"\n{name}"
            yield from (_line(row) for row in sorted(found, key=key)[:count])


def _line(row: Row) -> str:
    pair = worst(row)
    stated = "nothing" if pair.stated is None else f"{pair.stated:.3g} %"
    channel = max((c for c in row["channels"].items() if c[1]["decisive"]), key=lambda item: item[1]["true"])[0]
    accepted = "accepted" if row["acceptable"] else "refused"
    return (
        f"  seed {row['seed']}, {row['scheme']} ({row['taken']} at {1e3 * row['step']:.3g} ms): stated {stated}, true "
        f"{pair.true:.3g} % ({channel}), {accepted}, local error {row['coupled']:.2g} %\n      {row['case']}"
    )


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
    with tempfile.TemporaryDirectory() as folder:
        build_fmus((name for seed in left for name in draw_case(seed).fmu_names.values()), Path(folder))
        for found in track(_computed(left, which, Path(folder), workers), "systems", total=len(left), disable=quiet):
            rows += found
            if keep:
                with keep.open("a", encoding="utf-8") as stream:
                    stream.writelines(json.dumps(row) + "\n" for row in found)
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


def _computed(seeds: list[int], which: str, folder: Path, workers: int) -> Iterator[list[Row]]:
    """Yield the rows of each system when it is finished."""
    if workers <= 1 or len(seeds) <= 1:
        yield from (run_case(seed, which, folder) for seed in seeds)
        return
    threads = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    os.environ.update(dict.fromkeys(threads, "1"))  # the processes inherit it
    with ProcessPoolExecutor(min(workers, len(seeds)), mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(run_case, seed, which, folder) for seed in seeds]
        yield from (future.result() for future in as_completed(futures))


def main() -> None:
    """Run and print."""
    parser = parser_of(__doc__)
    parser.add_argument("--systems", type=int, default=400, help="number of systems")
    parser.add_argument("--seed-base", type=int, default=0, help="seed of the first system")
    parser.add_argument("--only", type=int, nargs="+", help="seeds to run, instead of a range")
    parser.add_argument("--workers", type=int, default=2, help="number of processes")
    told = "given: eight of the forty schemes at given steps, drawn for each system; all: with the default"
    parser.add_argument("--schemes", choices=("default", "given", "all"), default="default", help=told)
    parser.add_argument("--json", type=Path, help="file for the rows; rows already in it are not computed again")
    parser.add_argument("--names", type=int, default=8, help="number of worst runs to list, of each kind")
    options = parser.parse_args()
    seeds = options.only or range(options.seed_base, options.seed_base + options.systems)
    began = clock.perf_counter()
    rows = run_campaign(seeds, options.schemes, workers=options.workers, keep=options.json)
    for title, chosen in (
        ("the default", [row for row in rows if row["scheme"] == "default"]),
        ("given steps", [row for row in rows if row["scheme"] != "default"]),
    ):
        if chosen:
            print("\n".join([f"\n== {title}", *lines(chosen, names=options.names)]))
    print(f"\n{clock.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
