"""Identification of true cars, judged by the truth.

    python -m benchmarks.cars --kinds links rubber --seeds 1 2 --kept rows/
    python -m benchmarks.cars --kinds links --seeds 1 --shocks fitted --kept rows/

Each row is kept in the folder, and read from it when the command is given again. Seeds from 1000 are for reports.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from benchmarks.cars.draw import KINDS
from benchmarks.cars.judge import NAMES, RIDE, TOTAL, Case, row_of
from benchmarks.cars.rig import LAPS
from benchmarks.table import markdown, parser_of
from eightpost.array_types import Array
from eightpost.uncertainty import MeasureUncertainty, setup_distance

Row = dict[str, Any]

#: Levels of intervals, and limits of the bins of stated probabilities.
LEVELS, BINS = (0.5, 0.8, 0.95), (0.5, 0.6, 0.7, 0.8, 0.9, 0.98, 1.0)

#: Measures of which the lowest value is chosen.
CHOICES = (TOTAL, "front.ride_height", "rear.ride_height")


def names_of(row: Row, among: Sequence[str] = RIDE) -> list[str]:
    """Return the measures that are predicted."""
    return [name for name in among if name in row["predicted"][0]]


def errors(row: Row, among: Sequence[str] = RIDE) -> Array:
    """Return the errors of the predictions in percent (setups, measures)."""
    names = names_of(row, among)
    predicted, true = (np.array([[one[n] for n in names] for one in row[key]]) for key in ("predicted", "true"))
    return np.asarray(100.0 * (predicted / true - 1.0))


def lowest_spearman(row: Row) -> float:
    """Return the lowest rank correlation of a measure."""
    return min(
        float(spearmanr([one[n] for one in row["true"]], [one[n] for one in row["predicted"]]).statistic)
        for n in names_of(row)
    )


def stated(row: Row) -> dict[str, MeasureUncertainty]:
    """Return the stated uncertainties on the lap."""
    return {n: MeasureUncertainty(**one) for n, one in row.get("stated", {}).items() if n in names_of(row)}


def ridden(row: Row) -> list[dict[str, float]]:
    """Return the predicted measures that are judged, by which the distance of setups is computed."""
    return [{n: one[n] for n in names_of(row)} for one in row["predicted"]]


def inside(row: Row, level: float) -> dict[str, list[bool]]:
    """Return for each measure whether the true values of the setups are in their intervals."""
    uncertainties, rows = stated(row), ridden(row)
    middle = {n: float(np.exp(np.mean(np.log([one[n] for one in rows])))) for n in names_of(row)}
    found: dict[str, list[bool]] = {name: [] for name in uncertainties}
    for predicted, true in zip(rows, row["true"], strict=True):
        distance = setup_distance(predicted, middle)
        for name, one in uncertainties.items():
            change = float(np.log(predicted[name] / middle[name]))
            low, high = one.interval(predicted[name], level, distance=distance, change=change)
            found[name].append(low <= true[name] <= high)
    return found


def comparisons(row: Row) -> Array:
    """Return the stated probability of the more probable order of two setups, and whether it is true (pairs, 2)."""
    uncertainties, found = stated(row), []
    for (a, true_a), (b, true_b) in combinations(zip(ridden(row), row["true"], strict=True), 2):
        distance = setup_distance(a, b)
        for name, one in uncertainties.items():
            below = one.probability_below(a[name], b[name], distance=distance)
            found.append((max(below, 1.0 - below), float((below >= 0.5) == (true_a[name] < true_b[name]))))
    return np.array(found).reshape(-1, 2)


def regret(row: Row) -> float:
    """Return how much higher the true measure of the chosen setup is than the lowest one, at most, in percent."""
    worst = 0.0
    for name in CHOICES:
        true = np.array([one[name] for one in row["true"]])
        chosen = int(np.argmin([one[name] for one in row["predicted"]]))
        worst = max(worst, 100.0 * float(true[chosen] / true.min() - 1.0))
    return worst


def summary(rows: Iterable[Row]) -> str:
    """Return the table by kind of car, worst cars last, and the table of stated probabilities."""
    judged = [row for row in rows if "predicted" in row]
    heads = ("car lap s", "all %", "max %", "Spearman", "50 %", "80 %", "95 %", "worst measure 95 %", "regret %",
             "verdict", "cpu s")  # fmt: skip
    groups = [(f"{r['kind']} {r['seed']}", [r]) for r in judged]
    kinds = dict.fromkeys(r["kind"] for r in judged)
    groups += [(f"**{kind}**", [r for r in judged if r["kind"] == kind]) for kind in kinds]
    lines = [_cells(name, group) for name, group in [*groups, ("**all**", judged)] if group]
    lines += [[f"{r['kind']} {r['seed']}", r["error"]] for r in rows if "error" in r]
    return f"{markdown(heads, lines)}\n\n{probabilities(judged)}"


def _cells(name: str, rows: Sequence[Row]) -> list[str]:
    figures = np.concatenate([errors(row).ravel() for row in rows])
    covered = [[inside(row, level) for row in rows] for level in LEVELS]
    shares = [100.0 * np.mean([x for one in level for flags in one.values() for x in flags]) for level in covered]
    worst = {n: np.mean([x for one in covered[-1] for x in one.get(n, [])]) for n in (covered[-1][0] or {})}
    grades = ", ".join(sorted({str(row["verdict"]["grade"]) for row in rows}))
    return [
        f"{name} {rows[0]['lap']} {rows[0]['seconds']:g}",
        f"{np.sqrt(np.mean(figures**2)):.2f}",
        f"{np.abs(figures).max():.1f}",
        f"{min(map(lowest_spearman, rows)):.3f}",
        *(f"{share:.0f}" for share in shares),
        "" if not worst else f"{100.0 * min(worst.values()):.0f} {min(worst, key=lambda n: worst[n])}",
        f"{max(map(regret, rows)):.2f}",
        grades,
        f"{max(row['cpu'] for row in rows):.0f}",
    ]


def probabilities(rows: Sequence[Row]) -> str:
    """Return the table of stated probabilities that a setup is better than another, and how often it is."""
    pairs = np.concatenate([np.zeros((0, 2)), *map(comparisons, rows)])
    place = np.clip(np.digitize(pairs[:, 0], BINS) - 1, 0, len(BINS) - 2)
    lines = []
    for k in range(len(BINS) - 1):
        chosen = pairs[place == k]
        if len(chosen):
            mean, right = chosen.mean(axis=0)
            limits = f"{BINS[k]:g} to {BINS[k + 1]:g}"
            lines.append([limits, str(len(chosen)), f"{mean:.3f}", f"{right:.3f}", f"{right - mean:+.3f}"])
    return markdown(("stated", "pairs", "mean stated", "true", "difference"), lines)


def by_quantity(rows: Sequence[Row]) -> str:
    """Return RMS error and mean error of each quantity in percent, over all cars and setups."""
    found: dict[str, list[Array]] = {}
    for row in rows:
        for name, column in zip(names_of(row, NAMES), errors(row, NAMES).T, strict=True):
            found.setdefault(name.rpartition(".")[2], []).append(column)
    both = {name: (np.array(columns), np.array([c.mean() for c in columns])) for name, columns in found.items()}
    lines = [[name, *(f"{np.sqrt(np.mean(one**2)):.2f}" for one in pair)] for name, pair in both.items()]
    return markdown(("quantity", "RMS error %", "of the mean error of a car %"), lines)


def main() -> None:
    """Identify true cars and print the tables."""
    parser = parser_of(__doc__)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="kinds of cars")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1], help="seeds of each kind")
    parser.add_argument("--seconds", type=float, default=200.0, help="length of each of the five tests")
    parser.add_argument("--lap", choices=LAPS, default="track", help="lap on which setups are judged")
    parser.add_argument("--shocks", choices=("known", "fitted"), default="known", help="laws of the shocks: the true "
                        "ones, or fits of virtual dynamometer records")  # fmt: skip
    parser.add_argument("--kept", type=Path, required=True, help="folder of the rows")
    given = parser.parse_args()
    rows = []
    for seed, kind in product(given.seeds, given.kinds):
        rows.append(row_of(Case(kind, seed, given.seconds, given.lap, given.shocks), given.kept))
        print(f"{kind} {seed}: done", file=sys.stderr, flush=True)
    print(summary(rows))
    print("\n" + by_quantity([row for row in rows if "predicted" in row]))


if __name__ == "__main__":
    main()
