"""Benchmark of the stated uncertainty of identified vehicles: coverage of intervals, reliability of comparisons.

    python benchmarks/vehicle_uncertainty.py [--seeds FIRST:END] [--kinds NAMES] [--kept FOLDER] [--json FILE]

benchmarks/vehicle_uncertainty_truths.py describes the truths: the stand-in and the flexible car, each with random
parameters, drive, noise, lap and setups. --kept keeps the identified vehicles in a folder. Cars that resemble the model
less are those of benchmarks/cars.

The first table gives, for every measure, the share of true values within the stated intervals of 50, 80 and 95 %, over
all truths and setups and for each kind of truth, worst measure first, and beside the median width of the 95 % intervals
the median error. The second table gives the stated probability that the setup with the lower prediction is truly lower,
and how often it is, over all pairs of setups and all measures.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from itertools import combinations, product
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np

from benchmarks.identification import markdown
from benchmarks.vehicle_uncertainty_truths import KINDS, REPORT, Outcome, outcome
from eightpost.ident.vehicle.trust import UNUSABLE
from eightpost.measure_uncertainty import MeasureUncertainty, setup_distance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Row = dict[str, Any]

#: Levels of the intervals, and limits of the bins of stated probabilities.
LEVELS, BINS = (0.5, 0.8, 0.95), (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


def main() -> None:
    """Print the tables."""
    options = _options()
    seeds = REPORT if options.seeds is None else range(*options.seeds)
    kinds = options.kinds.split(",") if options.kinds else KINDS
    found, failed = [], []
    for seed, kind in product(seeds, kinds):
        one = outcome(kind, seed, options.kept)
        reported = "stable" if one.fit.stable else "reported as not stable"
        if one.predicted and one.fit.trust and one.fit.trust.measures:
            found.append(one)
            print(f"{kind} {seed}: {_summary(one)}, {reported}", file=sys.stderr, flush=True)
        else:
            missing = "uncertainty" if one.predicted else "prediction"
            failed.append(f"{kind} {seed} has no {missing}: {reported}, {_unusable(one)}")
    tables = {"coverage": coverage(found), "comparisons": comparisons(found)}
    print(f"{len(found)} truths", *failed, sep="\n")
    print(*(markdown(rows) for rows in tables.values()), sep="\n\n")
    if options.json:
        options.json.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")


def stated(one: Outcome) -> dict[str, MeasureUncertainty]:
    """Return the uncertainties on the lap."""
    assert one.fit.trust is not None
    return {name: one.fit.trust.measures[name].on_drive(shares.tolist()) for name, shares in one.shares.items()}


def coverage(outcomes: Sequence[Outcome]) -> list[Row]:
    """Return the share of true values within the intervals of each level, one row per measure, worst first."""
    rows: list[Row] = []
    half = {level: [_inside(one, level) for one in outcomes] for level in LEVELS}
    wide = LEVELS[-1]
    for k, name in enumerate(outcomes[0].names):
        row: Row = {"measure": name}
        for level, inside in half.items():
            row[f"{100 * level:g} %"] = _percent(np.concatenate(inside)[:, k])
        for kind in dict.fromkeys(one.kind for one in outcomes):
            of_kind = [inside[:, k] for one, inside in zip(outcomes, half[wide], strict=True) if one.kind == kind]
            row[f"{100 * wide:g} %, {kind}"] = _percent(np.concatenate(of_kind))
        widths = [stated(one)[name].half_width(0.0) for one in outcomes]
        row["half width, median %"] = round(100.0 * float(np.median(widths)), 2)
        sizes = np.abs(np.concatenate([one.errors()[:, k] for one in outcomes]))
        rows.append(row | {"error, median %": round(100.0 * float(np.median(sizes)), 2)})
    return sorted(rows, key=lambda row: min(v for n, v in row.items() if n.startswith(f"{100 * wide:g} %")))


def _inside(one: Outcome, level: float) -> NDArray[np.bool_]:
    """Return whether the true measures are within their intervals (setups, measures)."""
    middle = {n: float(np.exp(np.mean(np.log([row[n] for row in one.predicted])))) for n in one.names}
    uncertainty = stated(one)
    found = []
    for true, predicted in zip(one.true, one.predicted, strict=True):
        distance = setup_distance(predicted, middle)
        changes = {n: float(np.log(predicted[n] / middle[n])) for n in one.names}
        limits = [uncertainty[n].interval(predicted[n], level, distance=distance, change=changes[n]) for n in one.names]
        found.append([low <= true[n] <= high for n, (low, high) in zip(one.names, limits, strict=True)])
    return np.array(found)


def _percent(values: NDArray[np.bool_]) -> float:
    return round(100.0 * float(np.mean(values)), 1)


def comparisons(outcomes: Sequence[Outcome]) -> list[Row]:
    """Return the stated and the observed share of correct comparisons by bins: all pairs, by kind, and similar laws."""
    rows: list[Row] = []
    for group in ("all", *dict.fromkeys(one.kind for one in outcomes), "similar laws"):
        chosen = [one for one in outcomes if group in (one.kind, "all", "similar laws")]
        pairs = [_pairs(one, one.similar if group == "similar laws" else 0) for one in chosen]
        rows += _bins(group, np.concatenate(pairs), BINS)
    return rows


def _bins(group: str, pairs: Array, limits: Sequence[float]) -> list[Row]:
    """Return the mean stated probability (pairs[:, 0]) and the share that was right (pairs[:, 1]) of each bin."""
    place = np.clip(np.digitize(pairs[:, 0], limits) - 1, 0, len(limits) - 2)
    rows: list[Row] = []
    for k in range(len(limits) - 1):
        chosen = pairs[place == k]
        if len(chosen):
            mean, right = chosen.mean(axis=0)
            row = {"setups": group, "stated": f"{limits[k]:g} to {limits[k + 1]:g}", "pairs": len(chosen)}
            rows.append(row | {"mean stated": mean, "correct": right, "difference": right - mean})
    return rows


def _pairs(one: Outcome, first: int) -> Array:
    """Return the stated probability of the more probable order of two setups, and whether it is the true order."""
    uncertainties = stated(one)
    rows, found = list(zip(one.true, one.predicted, strict=True))[first:], []
    for (true_a, a), (true_b, b) in combinations(rows, 2):
        distance = setup_distance(a, b)
        for name in one.names:
            below = uncertainties[name].probability_below(a[name], b[name], distance=distance)
            found.append((max(below, 1.0 - below), float((below >= 0.5) == (true_a[name] < true_b[name]))))
    return np.array(found)


def _unusable(one: Outcome) -> str:
    """Return what the fit reports of a vehicle without figures."""
    flags = {} if one.fit.trust is None else one.fit.trust.flags
    return flags.get(UNUSABLE, "no flag")


def _summary(one: Outcome) -> str:
    errors = 100.0 * one.errors()
    mean = float(np.sqrt(np.mean(errors.mean(axis=0) ** 2)))
    return f"common error {mean:.2g} %, own error {float(np.sqrt(np.mean(errors.var(axis=0)))):.2g} %"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=lambda text: tuple(map(int, text.split(":"))), help="first seed and end, 0:3")
    parser.add_argument("--kinds", help=f"kinds of truths, separated by commas: {', '.join(KINDS)}")
    parser.add_argument("--kept", type=Path, help="keep the identified vehicles in this folder, or read them from it")
    parser.add_argument("--json", type=Path, help="write the tables to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
