"""Benchmark of the certainty of studies: stated probabilities against what is true of known cars.

    python -m benchmarks.certainty [--seeds FIRST:END] [--kinds NAMES] [--setups N] [--shocks known|fitted]
        [--kept FOLDER] [--json FILE]

The truths are those of benchmarks/vehicle_uncertainty.py: stand-ins and flexible cars with random parameters.
For each of them, N random setups of the seven builds of Table 7.3 are predicted, and simulated with the true car.
Each measure is the criterion of a study of its own. A study is then repeated with the three rig runs that it proposes:
the true levels of all measures with a run-to-run deviation of 0.3 %. The laws of the shocks are known; with --shocks
fitted, the true car has physical dampers and the prediction has laws Hysteresis fitted to two dynamometer tests of
each, whose stated uncertainty is included.

Tables: how often the ties contain the truly best setup, their number, and the regret (true level of the chosen setup
above the lowest one); the stated probability of being best, and of being better than another setup, with how often it
is true; the coverage of the intervals. A short version: --seeds 1000:1001 --setups 40.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np

from benchmarks.certainty_levels import Levels, levels_of
from benchmarks.identification import markdown
from benchmarks.vehicle_uncertainty import stated
from benchmarks.vehicle_uncertainty_truths import KINDS, LAP, REPORT, Outcome, outcome
from cosim.study.certainty.assess import observations_of
from cosim.study.certainty.certainty import PROBABILITIES, TIE, ConfirmedRun
from cosim.study.certainty.choice import Criterion, Drawn, candidates, draw_choice, drawn_levels, tests_of
from cosim.study.certainty.posterior import Observations, Posterior
from cosim.study.certainty.sources import error_sources
from cosim.study.columns import result_table, study_schema
from cosim.study.measures import Measure
from cosim.study.provenance import Provenance
from cosim.study.result import StudyResult
from cosim.study.study import Build, Drive, Study, Vehicle
from eightpost.corners import CORNERS
from eightpost.errors import StepError
from eightpost.measure_uncertainty import TOTAL, MeasureUncertainty
from eightpost.model_uncertainty import ModelUncertainty
from eightpost.rig import BUILDS
from eightpost.validity import Validity
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Row = dict[str, Any]

#: Draws of each study, number of proposed tests, run-to-run deviation of the rig [1], setups compared in pairs.
DRAWS, TESTS, NOISE, PAIRED = 4096, 3, 0.003, 40

#: Limits of the bins of probabilities of being best, and of being better than another setup.
BEST_BINS, BETTER_BINS = (0.005, 0.02, 0.1, 0.3, 0.6, 0.9, 1.0), (0.5, 0.6, 0.7, 0.8, 0.9, 0.98, 1.0)


@dataclass(slots=True)
class Tally:
    """Observations of one stage, before or after the proposed tests."""

    contained: list[bool] = field(default_factory=list)  #: Whether the ties contain the truly best setup, by study.
    sizes: list[int] = field(default_factory=list)  #: Number of ties, by study.
    #: True level of the chosen setup above the lowest one, relative, by study.
    regrets: list[float] = field(default_factory=list)
    #: Stated probability of being best, and whether the setup is it.
    chances: list[tuple[float, bool]] = field(default_factory=list)
    #: Stated probability that one setup is better than another, and whether it is.
    better: list[tuple[float, bool]] = field(default_factory=list)
    #: Whether true levels are inside the intervals of each probability, by measure.
    inside: dict[str, list[tuple[bool, ...]]] = field(default_factory=dict)


def main() -> None:
    """Print the tables."""
    options = _options()
    seeds = REPORT if options.seeds is None else range(*options.seeds)
    kinds = options.kinds.split(",") if options.kinds else KINDS
    before, after = ({kind: Tally() for kind in kinds} for _ in range(2))
    for seed in seeds:
        for kind in kinds:
            try:
                one = outcome(kind, seed, options.kept)
                levels = levels_of(one, options.setups, options.kept, options.shocks)
            except StepError as error:
                print(f"{kind} {seed} has no prediction: {error}", flush=True)
                continue
            add_truth(one, levels, before[kind], after[kind])
            print(f"{kind} {seed} done", file=sys.stderr, flush=True)
    stages = {"as predicted": before, f"after {TESTS} proposed tests": after}
    tables = {
        "choice": [row for stage, tallies in stages.items() for row in choice_rows(stage, tallies)],
        "best": [row for stage, tallies in stages.items() for row in probability_rows(stage, tallies, "chances")],
        "better": [row for stage, tallies in stages.items() for row in probability_rows(stage, tallies, "better")],
        "coverage": [row for stage, tallies in stages.items() for row in coverage_rows(stage, tallies)],
    }
    print(*(markdown(rows) for rows in tables.values()), sep="\n\n")
    if options.json:
        options.json.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")


def study_of(levels: Levels, uncertainties: dict[str, MeasureUncertainty]) -> StudyResult:
    """Return the study of the predicted levels, with a vehicle that states these uncertainties."""
    wheels = tuple(f"car.{corner}.tire_force" for corner in CORNERS)
    measures = tuple(Measure(name, wheels if name == TOTAL else (f"car.{name}",)) for name in levels.names)
    study = Study(
        "choice",
        Vehicle(Path("car.fmu")),
        {build: Build(Path(f"{place}.fmu")) for place, build in enumerate(BUILDS)},
        dict.fromkeys(CORNERS, tuple(BUILDS)),
        (Drive("lap", Path("lap.parquet"), LAP),),
        measures,
    )
    state = {"status": "done", "message": "", "coupling_error_percent": 0.0, "marks": "", "seconds": 0.0}
    rows = [
        {"setup": number, **study.space.setup(number).builds, **dict(zip(levels.names, values, strict=True)), **state}
        for number, values in zip(levels.setups.tolist(), levels.predicted.tolist(), strict=True)
    ]
    si = dict.fromkeys(levels.names, "1")
    validity = Validity(Verdict([]), (), ModelUncertainty(measures=uncertainties)).to_json()
    provenance = Provenance("0" * 64, {}, {}, {}, si, models={"car.fmu": validity})
    return StudyResult(study, result_table(rows, study_schema(study, si)), provenance, partial=True)


def add_truth(one: Outcome, levels: Levels, before: Tally, after: Tally) -> None:
    """Add the studies of one truth, each measure once as the criterion."""
    result = study_of(levels, stated(one))
    noise = {name: NOISE * float(np.mean(column)) for name, column in zip(levels.names, levels.true.T, strict=True)}
    sources = error_sources(result, levels.effects, noise)
    prior = Posterior(sources, Observations.none())
    generator = np.random.default_rng([13, one.seed])
    _add_coverage(prior, levels, before)
    for m, name in enumerate(levels.names):
        drawn, ties = _choice(result, prior, name)
        _add_choice(drawn, ties, levels.true[:, m], before)
        _add_pairs(prior, m, levels.true[:, m], before, one.seed)
        proposed = tests_of(result, drawn, ties, 0.0, TESTS)
        runs = [_rig_run(test.setup, levels, generator) for test in proposed]
        posterior = Posterior(sources, observations_of(result, sources, runs)) if runs else prior
        drawn, ties = _choice(result, posterior, name)
        _add_choice(drawn, ties, levels.true[:, m], after)
        _add_pairs(posterior, m, levels.true[:, m], after, one.seed)
        _add_coverage(posterior, levels, after, only=m)


def _choice(result: StudyResult, posterior: Posterior, name: str) -> tuple[Drawn, NDArray[np.int64]]:
    criterion = Criterion.of(result, name)
    rows, _ = candidates(posterior, criterion, np.ones(len(result)), 1)
    drawn = draw_choice(posterior, criterion, (), rows, top=1, count=DRAWS, seed=1)
    return drawn, drawn.ties(TIE)


def _rig_run(setup: int, levels: Levels, generator: np.random.Generator) -> ConfirmedRun:
    row = int(np.searchsorted(levels.setups, setup))
    values = levels.true[row] * (1.0 + NOISE * generator.standard_normal(len(levels.names)))
    return ConfirmedRun("run", setup, "lap", "", dict(zip(levels.names, values.tolist(), strict=True)))


def _add_choice(drawn: Drawn, ties: NDArray[np.int64], true: Array, tally: Tally) -> None:
    best = int(np.argmin(true))
    rows = drawn.rows[ties]
    tally.contained.append(best in rows)
    tally.sizes.append(len(rows))
    tally.regrets.append(float(true[rows[0]] / true[best] - 1.0))
    tally.chances += [(float(p), int(row) == best) for row, p in zip(drawn.rows, drawn.probability, strict=True)]


def _add_pairs(posterior: Posterior, m: int, true: Array, tally: Tally, seed: int) -> None:
    """Add pairs of setups: the probability of the more probable order, and whether it is the true one."""
    generator = np.random.default_rng([17, seed])
    rows = generator.permutation(true.size)[:PAIRED]
    groups = posterior.scales.groups(64, generator)
    levels = np.vstack([drawn_levels(posterior, posterior.draw(g, 16, generator), rows, m, generator) for g in groups])
    for a in range(rows.size):
        for b in range(a):
            below = float(np.mean(levels[:, a] < levels[:, b]))
            order = bool(true[rows[a]] < true[rows[b]])
            tally.better.append((max(below, 1.0 - below), order == (below >= 0.5)))


def _add_coverage(posterior: Posterior, levels: Levels, tally: Tally, only: int | None = None) -> None:
    predicted = posterior.sources.predicted
    for m, name in enumerate(levels.names):
        if only not in (None, m):
            continue
        weights = np.zeros(predicted.shape)
        weights[:, m] = 1.0
        middle, half = posterior.half_widths(PROBABILITIES, weights)
        apart = np.abs(np.log(levels.true[:, m] / predicted[:, m]) - middle)
        tally.inside.setdefault(name, []).extend(map(tuple, (apart <= half).T.tolist()))


def choice_rows(stage: str, tallies: dict[str, Tally]) -> Iterator[Row]:
    """Yield how often the ties contain the best setup, their number and the regret, for each kind and all together."""
    for kind, tally in _with_all(tallies):
        sizes, regrets = np.array(tally.sizes), 100.0 * np.array(tally.regrets)
        row = {"stage": stage, "cars": kind, "studies": len(sizes)}
        row |= {"best among the ties, %": round(100.0 * float(np.mean(tally.contained)), 1)}
        row |= {f"ties, {name}": float(np.quantile(sizes, q)) for name, q in (("maximum", 1.0), ("median", 0.5))}
        yield row | {
            f"regret %, {name}": float(np.quantile(regrets, q))
            for name, q in (("maximum", 1.0), ("95 % of studies", 0.95), ("median", 0.5))
        }


def probability_rows(stage: str, tallies: dict[str, Tally], what: str) -> Iterator[Row]:
    """Yield stated probabilities and how often they are true, by kind and bins, the largest difference first."""
    rows: list[Row] = []
    bins = BEST_BINS if what == "chances" else BETTER_BINS
    groups = {kind: getattr(tally, what) for kind, tally in tallies.items()}
    groups["all"] = [pair for pairs in groups.values() for pair in pairs]
    for kind, found in groups.items():
        pairs = np.array(found, dtype=np.float64)
        place = np.clip(np.digitize(pairs[:, 0], bins) - 1, -1, len(bins) - 2)
        for k in range(len(bins) - 1):
            chosen = pairs[place == k]
            if len(chosen):
                mean, true = chosen.mean(axis=0)
                row = {"stage": stage, "cars": kind, "stated": f"{bins[k]:g} to {bins[k + 1]:g}", "number": len(chosen)}
                rows.append(row | {"mean stated": mean, "true": true, "difference": true - mean})
    yield from sorted(rows, key=lambda row: -abs(row["difference"]))


def coverage_rows(stage: str, tallies: dict[str, Tally]) -> Iterator[Row]:
    """Yield the share of true levels within the intervals by measure, the lowest share of 95 % first."""
    rows: list[Row] = []
    for name in dict.fromkeys(name for tally in tallies.values() for name in tally.inside):
        inside = np.array([flags for tally in tallies.values() for flags in tally.inside.get(name, [])])
        shares = {
            f"{100 * p:g} %": round(100.0 * float(column.mean()), 1)
            for p, column in zip(PROBABILITIES, inside.T, strict=True)
        }
        rows.append({"stage": stage, "measure": name, **shares})
    yield from sorted(rows, key=lambda row: row["95 %"])


def _with_all(tallies: dict[str, Tally]) -> Sequence[tuple[str, Tally]]:
    whole = Tally()
    for tally in tallies.values():
        for name in ("contained", "sizes", "regrets"):
            getattr(whole, name).extend(getattr(tally, name))
    return [*tallies.items(), ("all", whole)]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=lambda text: tuple(map(int, text.split(":"))), help="first seed and end, 0:3")
    parser.add_argument("--kinds", help=f"kinds of truths, separated by commas: {', '.join(KINDS)}")
    parser.add_argument("--setups", type=int, default=200, help="number of setups of each truth (default 200)")
    parser.add_argument("--shocks", choices=("known", "fitted"), default="known", help="laws of the shocks")
    parser.add_argument(
        "--kept", type=Path, help="keep the identified vehicles and levels in this folder, or read them"
    )
    parser.add_argument("--json", type=Path, help="write the tables to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
