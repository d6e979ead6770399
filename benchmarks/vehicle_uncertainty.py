"""Benchmark of the stated uncertainty of identified vehicles: coverage of intervals, reliability of comparisons.

    python benchmarks/vehicle_uncertainty.py [--seeds FIRST:END] [--kinds NAMES] [--kept FOLDER] [--json FILE]
    python benchmarks/vehicle_uncertainty.py --tune

benchmarks/vehicle_uncertainty_truths.py describes the truths: the stand-in and the flexible car, each with random
parameters, drive, noise, lap and setups. The default seeds are those of the report; --tune prints the shares of
`ModelForm` that fit the tuning seeds best, and then their results. --kept keeps the identified vehicles in a folder.

The first table gives, for every measure, the share of true values within the stated intervals of 50, 80 and 95 %, over
all truths and setups and for each kind of truth, worst measure first. The second table gives the stated probability
that the setup with the lower prediction is truly lower, and how often it is, over all pairs of setups and all measures.
The third gives the stated probability that a setup has the lowest value of all, from drawn errors, and how often it
has. Values are for the share of the lap's power above the model's band, as a study knows it.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np
from scipy.optimize import minimize
from scipy.stats import invgamma
from scipy.stats import t as student

from benchmarks.identification import markdown
from benchmarks.vehicle_uncertainty_truths import KINDS, RECIPES, REPORT, TUNING, Outcome, outcome
from eightpost.ident.vehicle.model_form import ModelForm, Shares, noise_of
from eightpost.ident.vehicle.trust import UNUSABLE
from eightpost.measure_uncertainty import DEGREES, MeasureUncertainty, SetupErrors, separation, setup_distance

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Row = dict[str, Any]

#: Levels of the intervals, and limits of the bins of stated probabilities.
LEVELS, BINS = (0.5, 0.8, 0.95), (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


#: Smallest distance of setups whose errors are compared in the choice of the shares [1].
_HARDLY = 0.02

#: Draws of the errors of all setups.
DRAWS = 2000


class Part(NamedTuple):
    """Residuals of one measure of one truth, and its mean error."""

    inside: float  #: Residual in the band of the model [1].
    above: float  #: Residual above the band [1].
    share: float  #: Share of the tests' power above the band [1].
    noise: float  #: Standard deviation due to noise [1].
    lap: float  #: Share of the lap's power above the band [1].
    error: float  #: Mean error of the setups [1].


def main() -> None:
    """Print the tables."""
    options = _options()
    seeds = TUNING if options.tune else REPORT if options.seeds is None else range(*options.seeds)
    kinds = options.kinds.split(",") if options.kinds else KINDS
    recipes = tuple(RECIPES) if options.tune else ("shipped",)
    found, failed = [], []
    for seed, kind, recipe in product(seeds, kinds, recipes):
        one = outcome(kind, seed, options.kept, recipe)
        reported = "stable" if one.fit.stable else "reported as not stable"
        if one.predicted and one.fit.trust and one.fit.trust.measures:
            found.append(one)
            print(f"{kind} {seed}: {_summary(one)}, {reported}", file=sys.stderr, flush=True)
        else:
            missing = "uncertainty" if one.predicted else "prediction"
            failed.append(f"{kind} {seed} has no {missing}: {reported}, {_unusable(one)}")
    settings = tuned(found) if options.tune else ModelForm()
    tables = {
        "coverage": coverage(found, settings),
        "comparisons": comparisons(found, settings),
        "best": best(found, settings),
    }
    shares = ", ".join(f"{name} {tuple(getattr(settings, name))}" for name in ("inside", "above", "noise", "least"))
    print(f"{len(found)} truths; {shares}", *failed, sep="\n")
    print(*(markdown(rows) for rows in tables.values()), sep="\n\n")
    if options.json:
        options.json.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")


def stated(one: Outcome, settings: ModelForm) -> dict[str, MeasureUncertainty]:
    """Return the uncertainties on the lap that a fit with other settings would have, from the kept residuals."""
    return {
        name: settings.of_residual(part.inside, part.above, part.share, part.noise).at_share(part.lap)
        for name, part in parts(one).items()
    }


def parts(one: Outcome) -> dict[str, Part]:
    """Return the residuals and the mean error of every measure."""
    trust, errors = one.fit.trust, one.errors()
    assert trust is not None
    found = {}
    for k, name in enumerate(one.names):
        kept, noise = trust.measures[name], noise_of(name, trust.outputs)
        error = float(errors[:, k].mean())
        found[name] = Part(kept.common, kept.own, kept.share_above, noise, one.shares[name], error)
    return found


def tuned(outcomes: Sequence[Outcome]) -> ModelForm:
    """Return the settings that fit truths best.

    The shares of the common error are those for which the errors of all measures are most likely, times the factor that
    the quantity with the largest errors needs. The shares of the own error, and the smallest one, are those for which
    the RMS differences of the errors of setups, relative to their distance, are most likely.
    """
    parted = [parts(one) for one in outcomes]
    errors = np.array([[part.error for part in row.values()] for row in parted])

    def cost(shares: Array) -> float:
        scale = _scales(parted, shares)[0]
        return float(-np.mean(student.logpdf(errors / scale, DEGREES) - np.log(scale)))

    common = _least(cost, (0.3, 0.05, 1.5))
    ratio = errors / _scales(parted, common)[0]
    names = np.array([name.rpartition(".")[2] for name in outcomes[0].names])
    common = common * max(_factor(ratio[:, names == quantity]) for quantity in dict.fromkeys(names))
    sizes = np.array([own_errors(one) for one in outcomes])

    def loss(shares: Array) -> float:
        squares = (sizes / np.hypot(_scales(parted, shares[:3])[1], shares[3])) ** 2
        return float(-np.mean(invgamma.logpdf(squares, 0.5 * DEGREES, scale=0.5 * DEGREES) + np.log(squares)))

    own = _least(loss, (0.8, 0.2, 2.0, 1e-3))
    pairs = [Shares(round(float(a), 3), round(float(b), 3)) for a, b in zip(common, own[:3], strict=True)]
    smallest = Shares(0.0, round(float(own[3]), 4))
    return replace(ModelForm(), inside=pairs[0], above=pairs[1], noise=pairs[2], least=smallest)


def own_errors(one: Outcome) -> Array:
    """Return the RMS difference of the errors of two setups per unit of their separation, by measure (M,).

    Pairs of setups that hardly differ are left out.
    """
    errors, predicted = one.errors(), one.logarithms(one.predicted)
    first, second = np.triu_indices(len(errors), 1)
    changes = predicted[first] - predicted[second]
    distances = np.sqrt(np.mean(changes**2, axis=1))
    apart = np.vectorize(separation)(distances[:, None], changes)
    ratios = (errors[first] - errors[second]) / apart
    return np.asarray(np.sqrt(np.mean(ratios[distances > _HARDLY] ** 2, axis=0)))


def _scales(parted: Sequence[dict[str, Part]], shares: Array) -> tuple[Array, Array]:
    """Return the scales of the common and of the own errors for shares of the three parts, each (truths, measures)."""
    inside, above, noise = (Shares(float(share), float(share)) for share in shares)
    form = ModelForm(inside=inside, above=above, noise=noise, least=Shares(0.0, 0.0))
    found = [[form.of_residual(*part[:4]).at_share(part.lap) for part in row.values()] for row in parted]
    common, own = (np.array([[getattr(one, name) for one in row] for row in found]) for name in ("common", "own"))
    return common, own


def _least(cost: Callable[[Array], float], start: tuple[float, ...]) -> Array:
    """Return the positive shares with the lowest cost."""
    found = minimize(lambda x: cost(np.exp(x)), np.log(start), method="Nelder-Mead", tol=1e-4)
    return np.asarray(np.exp(found.x), dtype=np.float64)


def _factor(errors: Array) -> float:
    """Return the scale for which errors are most likely."""
    scales = np.geomspace(0.2, 5.0, 200)
    return float(max(scales, key=lambda scale: np.sum(student.logpdf(errors / scale, DEGREES) - np.log(scale))))


def coverage(outcomes: Sequence[Outcome], settings: ModelForm) -> list[Row]:
    """Return the share of true values within the intervals of each level, one row per measure, worst first."""
    rows: list[Row] = []
    half = {level: [_inside(one, settings, level) for one in outcomes] for level in LEVELS}
    wide = LEVELS[-1]
    for k, name in enumerate(outcomes[0].names):
        row: Row = {"measure": name}
        for level, inside in half.items():
            row[f"{100 * level:g} %"] = _percent(np.concatenate(inside)[:, k])
        for kind in dict.fromkeys(one.kind for one in outcomes):
            of_kind = [inside[:, k] for one, inside in zip(outcomes, half[wide], strict=True) if one.kind == kind]
            row[f"{100 * wide:g} %, {kind}"] = _percent(np.concatenate(of_kind))
        common = [stated(one, settings)[name].common for one in outcomes]
        rows.append(row | {"common, median %": round(100.0 * float(np.median(common)), 3)})
    return sorted(rows, key=lambda row: min(v for n, v in row.items() if n.startswith(f"{100 * wide:g} %")))


def _inside(one: Outcome, settings: ModelForm, level: float) -> NDArray[np.bool_]:
    """Return whether the true measures are within their intervals (setups, measures)."""
    middle = {n: float(np.exp(np.mean(np.log([row[n] for row in one.predicted])))) for n in one.names}
    uncertainty = stated(one, settings)
    found = []
    for true, predicted in zip(one.true, one.predicted, strict=True):
        distance = setup_distance(predicted, middle)
        changes = {n: float(np.log(predicted[n] / middle[n])) for n in one.names}
        limits = [uncertainty[n].interval(predicted[n], level, distance=distance, change=changes[n]) for n in one.names]
        found.append([low <= true[n] <= high for n, (low, high) in zip(one.names, limits, strict=True)])
    return np.array(found)


def _percent(values: NDArray[np.bool_]) -> float:
    return round(100.0 * float(np.mean(values)), 1)


def comparisons(outcomes: Sequence[Outcome], settings: ModelForm) -> list[Row]:
    """Return the stated and the observed share of correct comparisons by bins: all pairs, by kind, and similar laws."""
    rows: list[Row] = []
    for group in ("all", *dict.fromkeys(one.kind for one in outcomes), "similar laws"):
        chosen = [one for one in outcomes if group in (one.kind, "all", "similar laws")]
        pairs = [_pairs(one, settings, one.similar if group == "similar laws" else 0) for one in chosen]
        rows += _bins(group, np.concatenate(pairs), BINS)
    return rows


def best(outcomes: Sequence[Outcome], settings: ModelForm) -> list[Row]:
    """Return the stated probability that a setup has the lowest true value, and how often it has, by bins."""
    pairs = np.concatenate([_best(one, settings) for one in outcomes])
    return _bins("all", pairs, (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0))


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


def _pairs(one: Outcome, settings: ModelForm, first: int) -> Array:
    """Return the stated probability of the more probable order of two setups, and whether it is the true order."""
    uncertainties = stated(one, settings)
    rows, found = list(zip(one.true, one.predicted, strict=True))[first:], []
    for (true_a, a), (true_b, b) in combinations(rows, 2):
        distance = setup_distance(a, b)
        for name in one.names:
            below = uncertainties[name].probability_below(a[name], b[name], distance=distance)
            found.append((max(below, 1.0 - below), float((below >= 0.5) == (true_a[name] < true_b[name]))))
    return np.array(found)


def _best(one: Outcome, settings: ModelForm) -> Array:
    """Return the stated probability that each setup has the lowest value of a measure, and whether it has."""
    logarithms, true = one.logarithms(one.predicted), one.logarithms(one.true)
    table = {name: np.exp(row) for name, row in zip(one.names, logarithms.T, strict=True)}
    errors, generator = SetupErrors.of(table, stated(one, settings)), np.random.default_rng([one.seed, 3])
    found = []
    for k, name in enumerate(one.names):
        lowest = np.argmin(logarithms[:, k] - errors.draw_own(name, DRAWS, generator), axis=1)
        probability = np.bincount(lowest, minlength=len(true)) / DRAWS
        found.append(np.column_stack([probability, np.arange(len(true)) == np.argmin(true[:, k])]))
    return np.concatenate(found)


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
    parser.add_argument("--tune", action="store_true", help="choose the shares with the tuning seeds")
    parser.add_argument("--kept", type=Path, help="keep the identified vehicles in this folder, or read them from it")
    parser.add_argument("--json", type=Path, help="write the tables to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
