"""Prediction of a setting that was not measured: random virtual shocks with five files, fitted on four.

    python -m benchmarks.settings --shocks 40
    python -m benchmarks.settings --map      # curves of a damper's maker over two adjusters, needs EIGHTPOST_DATA

Each shock has random shims, jets and either a rebound bleed or a preload of the shims as its adjuster. It is tested at
five settings with a random motion. Each inner file is left out once; the model of the other four predicts its record
and its curve. Errors are in percent of the standard deviation of the force. The level of the force does not count,
because it is gas force. The coverage is the share of knots at which the left-out file's own curve is within both bands.
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from eightpost.array_types import Array
from eightpost.errors import EightpostError
from eightpost.ident.shock.runs import prepare_runs
from eightpost.ident.shock.settings.result import SettingsFit, fit_settings, held_out_percent
from eightpost.ident.shock.settings.table import SettingsTable
from eightpost.rig.damper import PhysicalDamper, configuration, shim_build
from eightpost.rig.damper.valves import SHIM_SETS, Bleed, MainPiston
from eightpost.rig.dynamometer import Actuator, measure, random_multisine
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS, Axis, Shock
from eightpost.shock.settings import node_weights

#: Clicks from full hard, and length [s] and rate [Hz] of the records.
MOST, DURATION, RATE = 28, 10.0, 1000.0


@dataclass(frozen=True, slots=True)
class RandomShock:
    """A virtual shock with one adjuster."""

    kind: str  #: `bleed` or `preload`.
    base: PhysicalDamper  #: Shock without its adjuster.
    most: float  #: Area of the open bleed [m2], or dish at the hardest setting [m].

    @classmethod
    def drawn(cls, random: np.random.Generator) -> RandomShock:
        """Return a random shock."""
        kind = str(random.choice(["bleed", "preload"]))
        soft = list(SHIM_SETS)[:13]
        base = shim_build(f"{random.choice(soft)}/{random.choice(soft)}")
        if random.random() < 0.5:
            base = configuration(int(random.integers(1, 13)))
        most = random.uniform(1.5e-6, 5e-6) if kind == "bleed" else random.uniform(0.2e-3, 0.6e-3)
        return cls(kind, base, float(most))

    def at(self, clicks: float) -> PhysicalDamper:
        """Return the shock at clicks from full hard."""
        share, piston = clicks / MOST, self.base.piston
        if self.kind == "bleed":
            return replace(self.base, piston=replace(piston, bleed=Bleed(MOST - round(clicks), self.most / MOST)))
        return replace(self.base, piston=_preloaded(piston, self.most * (1.0 - 0.9 * share)))


def _preloaded(piston: MainPiston, dish: float) -> MainPiston:
    return replace(piston, rebound=replace(piston.rebound, dish=dish))


def tested(shock: RandomShock, clicks: tuple[float, ...], seed: int, law: str = "lpf1") -> SettingsTable:
    """Return the table of a shock's files, measured on the virtual dynamometer, to be fitted with a law."""
    tests = []
    for k, value in enumerate(clicks):
        drive = random_multisine(seed + k, duration=DURATION, rate=2.0 * RATE)
        series = measure(shock.at(value), drive, rate=RATE, actuator=Actuator(), seed=seed + k)
        tests.append((DynoTest(series),))
    axis = Axis("rebound", clicks, clicks[len(clicks) // 2], counted="from full hard", lowest=0.0, highest=float(MOST))
    files = tuple(Path(f"{shock.kind}_{value:g}.csv") for value in clicks)
    return SettingsTable("random shock", law, "estimate", (axis,), tuple((c,) for c in clicks), tuple(tests), files)


@dataclass(frozen=True, slots=True)
class Row:
    """One prediction of a left-out file."""

    kind: str  #: Kind of the adjuster.
    own: float  #: Error of the fit to the file itself [%].
    predicted: float  #: Error of the prediction of its record [%].
    nearest: float  #: Error of the nearest measured setting's model on its record [%].
    truth: float  #: Error of the predicted curve from the dense static curve, over 95 % of the speeds [%].
    own_truth: float  #: The same of the file's own curve [%].
    coverage: float  #: Share of knots, over 95 % of the speeds, that the bands cover.


def rows_of(shock: RandomShock, table: SettingsTable) -> Iterator[Row]:
    """Yield a row for each inner file of a table."""
    whole = fit_settings(table)
    for number in range(1, len(table.files) - 1):
        others = fit_settings(table.without(number))
        yield _row(shock, table, number, whole, others)


def _row(shock: RandomShock, table: SettingsTable, number: int, whole: SettingsFit, others: SettingsFit) -> Row:
    clicks = table.settings[number][0]
    runs = prepare_runs(table.tests[number])
    predicted, own = (fit.shock.at(clicks={"rebound": clicks}) for fit in (others, whole))
    nodes = others.settings.axes[0].nodes
    nearest = others.shock.at(clicks={"rebound": min(nodes, key=lambda node: abs(node - clicks))})
    velocity = np.quantile(runs.velocity[runs.inside], np.linspace(0.025, 0.975, 61))
    truth = np.array([shock.at(clicks).static_force(float(v)) for v in velocity])
    return Row(
        shock.kind,
        held_out_percent(own.law, runs),
        held_out_percent(predicted.law, runs),
        held_out_percent(nearest.law, runs),
        _curve_error(predicted, velocity, truth),
        _curve_error(own, velocity, truth),
        _coverage(predicted, own, velocity),
    )


def _curve_error(shock: Shock, velocity: Array, truth: Array) -> float:
    error = np.array([shock.law.curve.force(float(v)) for v in velocity]) - truth
    return 100.0 * float(np.std(error) / np.std(truth))


def _coverage(predicted: Shock, own: Shock, velocity: Array) -> float:
    """Return the share of speeds at which the curves differ by less than both bands together."""
    bands = [_band(shock, velocity) for shock in (predicted, own)]
    differ = np.abs(bands[0][0] - bands[1][0])
    return float(np.mean(differ <= np.hypot(bands[0][1], bands[1][1])))


def _band(shock: Shock, velocity: Array) -> tuple[Array, Array]:
    band = shock.fit["curve_band"]
    force = np.array([shock.law.curve.force(float(v)) for v in velocity])
    return force, np.interp(velocity, band["velocity [m/s]"], band["half_width [N]"])


def _clicks(random: np.random.Generator) -> tuple[float, ...]:
    """Return five settings from end to end with intervals of at least 3 clicks."""
    while True:
        inner = np.sort(random.choice(np.arange(1, MOST), 3, replace=False))
        clicks = np.concatenate([[0], inner, [MOST]])
        if np.diff(clicks).min() >= 3:
            return tuple(float(value) for value in clicks)


def measured_rows(shocks: int, seed: int, law: str = "lpf1") -> list[Row]:
    """Return the rows of random shocks fitted with a law."""
    rows: list[Row] = []
    random = np.random.default_rng(seed)
    for number in range(shocks):
        shock, clicks = RandomShock.drawn(random), _clicks(random)
        try:
            with threadpool_limits(1, "blas"):
                rows += rows_of(shock, tested(shock, clicks, 1000 * seed + 10 * number, law))
        except EightpostError as error:
            print(f"shock {number}: {error}")
    return rows


# ---- Curves of a maker over two adjusters ---------------------------------------------------------------------------

#: Curves of a racing damper, digitised from its maker's plots; in the folder of measured data.
MAP = Path("ohlins") / "ohlins_vendor_FV_curves_digitised.csv"


def map_rows(folder: Path) -> Iterator[tuple[str, float, float, float]]:
    """Yield adjuster and setting, and the errors of a left-out curve [%]: model, straight line, nearest setting."""
    curves: dict[tuple[str, str], list[tuple[float, float]]] = {}
    with (folder / MAP).open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            curves.setdefault((row["side"], row["setting"]), []).append((float(row["v_mm_s"]), float(row["F_N"])))
    speed = np.linspace(0.0, 240.0, 61)
    for side in ("comp", "reb"):
        for adjuster, names in (("HS", [f"LS0_HS{k}" for k in range(5)]),
                                ("LS", [f"LS{k}_HS4" for k in (0, 2, 4, 6, 10, 15, 25)])):  # fmt: skip
            nodes = [float(name.partition(adjuster)[2].partition("_")[0]) for name in names]
            forces = np.array([np.interp(speed, *np.array(curves[side, name]).T) for name in names])
            for k in range(1, len(nodes) - 1):
                yield f"{side} {names[k]}", *_left_out(nodes, forces, k)


def _left_out(nodes: list[float], forces: Array, k: int) -> tuple[float, float, float]:
    kept = [i for i in range(len(nodes)) if i != k]
    weights = node_weights(tuple(nodes[i] for i in kept), nodes[k])
    share = (nodes[k] - nodes[k - 1]) / (nodes[k + 1] - nodes[k - 1])
    nearest = min(kept, key=lambda i: abs(nodes[i] - nodes[k]))
    found = (np.array(weights) @ forces[kept], (1.0 - share) * forces[k - 1] + share * forces[k + 1], forces[nearest])
    size = float(np.sqrt(np.mean(forces[k] ** 2)))
    model, line, near = (100.0 * float(np.sqrt(np.mean((force - forces[k]) ** 2))) / size for force in found)
    return model, line, near


def print_map(folder: Path) -> None:
    """Print the errors of the maker's curves, each predicted by the others."""
    print("| left-out curve | model, % | straight line, % | nearest setting, % |\n|---|---|---|---|")
    rows = list(map_rows(folder))
    for name, *errors in rows:
        print(f"| {name} | " + " | ".join(f"{error:.1f}" for error in errors) + " |")
    for what, share in (("worst", 100), ("median", 50)):
        values = np.percentile([errors for _, *errors in rows], share, axis=0)
        print(f"| {what} | " + " | ".join(f"{value:.1f}" for value in values) + " |")


def main() -> None:
    """Print the distributions, worst cases first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shocks", type=int, default=40, help="Number of random shocks.")
    parser.add_argument("--seed", type=int, default=1, help="Seed of shocks, motions and noise.")
    parser.add_argument("--law", choices=tuple(LAWS), default="lpf1", help="Law that is fitted.")
    parser.add_argument("--map", action="store_true", help="Evaluate the maker's curves in EIGHTPOST_DATA instead.")
    given = parser.parse_args()
    if given.map:
        print_map(Path(os.environ["EIGHTPOST_DATA"]))
        return
    rows = measured_rows(given.shocks, given.seed, given.law)
    print("| adjuster | files | figure | worst | 90 % | median |\n|---|---|---|---|---|---|")
    for kind in sorted({row.kind for row in rows}):
        these = [row for row in rows if row.kind == kind]
        for name in ("predicted", "own", "nearest", "truth", "own_truth"):
            values = np.percentile([getattr(row, name) for row in these], [100, 90, 50])
            print(f"| {kind} | {len(these)} | {name} | " + " | ".join(f"{value:.2f}" for value in values) + " |")
        covered = np.array([row.coverage for row in these])
        low = np.percentile(covered, [0, 10, 50])
        print(f"| {kind} | {len(these)} | coverage (mean {covered.mean():.3f}) | "
              + " | ".join(f"{value:.2f}" for value in low) + " |")  # fmt: skip


if __name__ == "__main__":
    main()
