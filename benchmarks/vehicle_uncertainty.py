"""Benchmark of the stated uncertainty of identified vehicles: coverage of intervals, reliability of comparisons.

    python benchmarks/vehicle_uncertainty.py [--seeds FIRST:END] [--kinds NAMES] [--kept FOLDER] [--json FILE]
    python benchmarks/vehicle_uncertainty.py --tune

benchmarks/vehicle_uncertainty_truths.py describes the truths: the stand-in and the flexible car, each with random
parameters, drive, noise, lap and setups. The default seeds are those of the report; --tune prints the shares of
`ModelForm` that fit the tuning seeds best, and then their results. --kept keeps the identified vehicles in a folder.

The first table gives, for every measure, the share of true values within the stated intervals of 50, 80 and 95 %, over
all truths and setups, worst measure first. The second table gives the stated probability that the setup with the lower
prediction is truly lower, and how often it is, over all pairs of setups and all measures.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np
from scipy.optimize import minimize
from scipy.stats import t as student

from benchmarks.identification import markdown
from benchmarks.vehicle_uncertainty_truths import KINDS, REPORT, TUNING, Outcome, outcome
from eightpost.errors import StepError
from eightpost.ident.vehicle.model_form import ModelForm, Shares
from eightpost.measure_uncertainty import DEGREES, MeasureUncertainty, setup_distance

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Row = dict[str, Any]

#: Levels of the intervals, and limits of the bins of stated probabilities.
LEVELS, BINS = (0.5, 0.8, 0.95), (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


class Part(NamedTuple):
    """Residuals and errors of one measure of one truth.

    Attributes:
        inside: Residual in the band of the model [1].
        above: Residual above the band [1].
        noise: Standard deviation due to noise [1].
        common: Mean error of the setups [1].
        own: RMS error between two setups per unit of their distance [1].
    """

    inside: float
    above: float
    noise: float
    common: float
    own: float


def main() -> None:
    """Print both tables."""
    options = _options()
    seeds = TUNING if options.tune else REPORT if options.seeds is None else range(*options.seeds)
    found, failed = [], []
    for seed in seeds:
        for kind in options.kinds.split(",") if options.kinds else KINDS:
            try:
                found.append(outcome(kind, seed, options.kept))
            except StepError as error:
                failed.append(f"{kind} {seed} has no prediction: {error}")
                continue
            print(f"{kind} {seed}: {_summary(found[-1])}", file=sys.stderr, flush=True)
    settings = tuned(found) if options.tune else ModelForm()
    tables = {"coverage": coverage(found, settings), "comparisons": comparisons(found, settings)}
    print(f"{len(found)} truths; inside {tuple(settings.inside)}, above {tuple(settings.above)}", *failed, sep="\n")
    print(*(markdown(rows) for rows in tables.values()), sep="\n\n")
    if options.json:
        options.json.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")


def stated(one: Outcome, settings: ModelForm) -> dict[str, MeasureUncertainty]:
    """Return the uncertainties that a fit with other settings would have, from the residuals that were kept."""
    return {name: settings.of_residual(part.inside, part.above, part.noise) for name, part in parts(one).items()}


def parts(one: Outcome) -> dict[str, Part]:
    """Return the residuals and errors of every measure."""
    trust, errors = one.fit.trust, one.errors()
    assert trust is not None
    distances = np.array([setup_distance(a, b) for a, b in combinations(one.predicted, 2)])
    between = np.array([a - b for a, b in combinations(errors, 2)])
    own = np.sqrt(np.mean(between**2, axis=0) / np.mean(distances**2))
    found = {}
    for k, name in enumerate(one.names):
        noise, kept = ModelForm.noise(name, trust.outputs), trust.measures[name]
        inside, above = (float(np.sqrt(max(value**2 - noise**2, 0.0))) for value in (kept.common, kept.own))
        found[name] = Part(inside, above, noise, float(errors[:, k].mean()), float(own[k]))
    return found


def tuned(outcomes: Sequence[Outcome]) -> ModelForm:
    """Return the settings that fit truths best.

    The shares of the common error are those for which the errors of all measures are most likely, times the factor that
    the quantity with the largest errors needs. The shares of the own error are the most likely ones, times the factor
    for which the comparisons of setups are most likely.
    """
    rows = np.array([part for one in outcomes for part in parts(one).values()])
    names = [name.rpartition(".")[2] for one in outcomes for name in parts(one)]
    inside, above, noise, common, own = rows.T
    shares, other = (_likely(error, inside, above, noise) for error in (common, own))
    scale = np.sqrt((shares[0] * inside) ** 2 + (shares[1] * above) ** 2 + noise**2)
    groups = [np.array([name == quantity for name in names]) for quantity in dict.fromkeys(names)]
    shares = shares * max(_factor(common[group] / scale[group]) for group in groups)

    def settings(factor: float) -> ModelForm:
        pairs = [(round(float(a), 3), round(float(b * factor), 3)) for a, b in zip(shares, other, strict=True)]
        return replace(ModelForm(), inside=Shares(*pairs[0]), above=Shares(*pairs[1]))

    return settings(max(np.geomspace(0.4, 1.6, 13), key=lambda factor: _score(outcomes, settings(float(factor)))))


def _likely(error: Array, inside: Array, above: Array, noise: Array) -> Array:
    """Return the two shares of the residuals for which the errors are most likely."""

    def cost(logarithms: Array) -> float:
        a, b = np.exp(logarithms)
        scale = np.sqrt((a * inside) ** 2 + (b * above) ** 2 + noise**2)
        return float(-np.sum(student.logpdf(error / scale, DEGREES) - np.log(scale)))

    return np.exp(minimize(cost, np.log([0.3, 0.1]), method="Nelder-Mead").x)


def _factor(errors: Array) -> float:
    """Return the scale for which errors are most likely."""
    scales = np.geomspace(0.2, 5.0, 200)
    return float(max(scales, key=lambda scale: np.sum(student.logpdf(errors / scale, DEGREES) - np.log(scale))))


def _score(outcomes: Sequence[Outcome], settings: ModelForm) -> float:
    """Return the mean logarithm of the stated probability of what was observed."""
    stated, correct = np.array([pair for one in outcomes for pair in _pairs(one, settings, 0)]).T
    return float(np.mean(np.log(np.clip(np.where(correct > 0.5, stated, 1.0 - stated), 1e-6, 1.0))))


def coverage(outcomes: Sequence[Outcome], settings: ModelForm) -> list[Row]:
    """Return the share of true values within the intervals of each level, one row per measure, worst first."""
    rows: list[Row] = []
    for name in outcomes[0].names:
        hits: dict[float, list[bool]] = {level: [] for level in LEVELS}
        scales: list[float] = []
        for one in outcomes:
            uncertainty = stated(one, settings)[name]
            scales.append(uncertainty.common)
            middle = {n: float(np.exp(np.mean(np.log([row[n] for row in one.predicted])))) for n in one.names}
            for true, predicted in zip(one.true, one.predicted, strict=True):
                for level in LEVELS:
                    distance = setup_distance(predicted, middle)
                    low, high = uncertainty.interval(predicted[name], level, distance=distance)
                    hits[level].append(low <= true[name] <= high)
        shares = {f"{100 * level:g} %": round(100.0 * float(np.mean(hits[level])), 1) for level in LEVELS}
        rows.append({"measure": name, **shares, "common, median %": 100.0 * float(np.median(scales))})
    return sorted(rows, key=lambda row: float(row[f"{100 * LEVELS[-1]:g} %"]))


def comparisons(outcomes: Sequence[Outcome], settings: ModelForm) -> list[Row]:
    """Return the stated and the observed share of correct comparisons by bins, for all pairs and for similar setups."""
    rows = []
    for group in ("all", "similar laws"):
        first = [0 if group == "all" else one.similar for one in outcomes]
        pairs = np.array([pair for one, k in zip(outcomes, first, strict=True) for pair in _pairs(one, settings, k)])
        place = np.clip(np.digitize(pairs[:, 0], BINS) - 1, 0, len(BINS) - 2)
        for k in range(len(BINS) - 1):
            chosen = pairs[place == k]
            if len(chosen):
                mean, right = chosen.mean(axis=0)
                limits = f"{BINS[k]:g} to {BINS[k + 1]:g}"
                row = {"setups": group, "stated": limits, "pairs": len(chosen), "mean stated": mean}
                rows.append(row | {"correct": right, "difference": right - mean})
    return rows


def _pairs(one: Outcome, settings: ModelForm, first: int) -> Iterable[tuple[float, float]]:
    """Yield the stated probability of the more probable order of two setups, and whether it is the true order."""
    uncertainties = stated(one, settings)
    rows = list(zip(one.true, one.predicted, strict=True))[first:]
    for (true_a, a), (true_b, b) in combinations(rows, 2):
        distance = setup_distance(a, b)
        for name in one.names:
            below = uncertainties[name].probability_below(a[name], b[name], distance=distance)
            yield max(below, 1.0 - below), float((below >= 0.5) == (true_a[name] < true_b[name]))


def _summary(one: Outcome) -> str:
    errors = 100.0 * one.errors()
    mean = float(np.sqrt(np.mean(errors.mean(axis=0) ** 2)))
    return f"common error {mean:.2g} %, own error {float(np.sqrt(np.mean(errors.var(axis=0)))):.2g} %"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=lambda text: tuple(map(int, text.split(":"))), help="first seed and end, 0:3")
    parser.add_argument("--kinds", help=f"kinds of truths, separated by commas: {', '.join(KINDS)}")
    parser.add_argument("--tune", action="store_true", help="choose the shares with the tuning seeds")
    parser.add_argument("--kept", type=Path, help="keep the identified vehicles in this folder, or read them from it")
    parser.add_argument("--json", type=Path, help="write the tables to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
