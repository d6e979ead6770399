"""Regret of each law on measured records: its error over that of the best law in hindsight, minus 1."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby, permutations, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.table import markdown, number
from benchmarks.verdicts.cases import Case, part, percent, whole
from eightpost.ident import fit_shock
from eightpost.ident.shock.law_fit import DEFAULT_LAW
from eightpost.ident.shock.runs import CUTOFF, FILTER_EDGE, prepare_runs
from eightpost.rig import DynoTest, read_dyno_test
from eightpost.shock import LAWS

#: Kinds of splits.
TIME, RUN = "half or a third of the run", "another run of the same motion"
REST, SPEED = "half or a third that has a rest, fitted without one", "another run, 4 times as fast or slow"

#: Fitted and held-out part of a record as shares of its length.
PARTS = (((0, 1 / 2), (1 / 2, 1)), ((1 / 2, 1), (0, 1 / 2)), ((0, 2 / 3), (2 / 3, 1)), ((1 / 3, 1), (0, 1 / 3)))

#: Share of the peak speed below which a shock is at rest, and share of the time from which a part has a rest.
STILL, RESTING = 0.02, 0.05

#: Time before and after a part that only the low-pass uses [s].
EDGE = FILTER_EDGE / CUTOFF


def splits(folder: Path) -> Iterator[Case]:
    """Yield the splits of the records in the folders `labcontrol` and `ohlins`; the held-out one is named by its kind.

    Each record is divided into a fitted and a held-out part. Of the runs of one setting, each predicts each other one.
    A held-out part begins with its first motion: before it, dry friction holds a level that no law can know.
    """
    paths = sorted([*folder.glob("labcontrol/*.csv"), *folder.glob("ohlins/ohlins_t1_*.csv")])
    for _, setting in groupby(paths, key=lambda path: re.split("_s|_ensaio", path.stem)[0]):
        runs = {path.stem: read_dyno_test(path, flip=("force",) * ("18_18" in path.stem)) for path in setting}
        for (name, run), shares in product(runs.items(), PARTS):
            end = run.series.duration
            kept, left = (part(run, max(a * end - EDGE, 0.0), min(b * end + EDGE, end)) for a, b in shares)
            left = part(left, float(left.series.time[np.argmax(~_is_still(left))] - left.series.time[0]), np.inf)
            kind = REST if _rests(left) and not _rests(kept) else TIME
            yield Case(f"{name}, {shares}", (kept,), {kind: left})
        for one, other in permutations(runs, 2):
            kind = RUN if prepare_runs([runs[one], runs[other]]).has_repeated_motions else SPEED
            yield Case(f"{one}, {other}", (runs[one],), {kind: runs[other]})


def _is_still(run: DynoTest) -> NDArray[np.bool_]:
    speed = np.abs(run.series["velocity"])
    return np.asarray(speed <= STILL * speed.max())


def _rests(run: DynoTest) -> bool:
    """Return whether the shock is at rest for more than moments."""
    return bool(np.mean(_is_still(run)) > RESTING)


def rows_of(found: Case) -> Iterator[dict[str, Any]]:
    """Yield the error of each law [%]."""
    for kind, record in found.held_out.items():
        shocks = {law: fit_shock(found.fitted, law, segment=whole(found.fitted[0])).shock for law in LAWS}
        errors = {law: percent(shock, record, about_mean=kind in (RUN, SPEED)) for law, shock in shocks.items()}
        yield {"case": found.name, "kind": kind, "errors": errors}


def report(rows: Sequence[dict[str, Any]]) -> str:
    """Return median error and mean regret of each law for each kind of split, as Markdown."""
    default = list(LAWS).index(DEFAULT_LAW["joint"])
    heads = ("held out", *(f"{law} [%]" for law in LAWS), "mean regret of these [%]", "worst", "best within 5 %")
    lines = []
    for kind in (TIME, RUN, REST, SPEED, "all"):
        errors = np.array([list(row["errors"].values()) for row in rows if kind in ("all", row["kind"])])
        if errors.size:
            regret = 100.0 * (errors / errors.min(axis=1, keepdims=True) - 1.0)
            mean, worst = ", ".join(map(number, regret.mean(axis=0))), number(float(regret[:, default].max()))
            close = str(np.sum(regret[:, default] <= 5.0))
            lines.append((f"{kind} ({len(errors)})", *map(number, np.median(errors, axis=0)), mean, worst, close))
    return markdown(heads, lines)
