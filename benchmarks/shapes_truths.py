"""Target curves on identified cars, verified on the true cars: predicted, assured and true gain over the bank.

    python -m benchmarks.shapes_truths [--seeds FIRST:END] [--kinds NAMES] [--kept FOLDER] [--json FILE]

The truths are those of benchmarks/vehicle_uncertainty.py: stand-ins and flexible cars with random parameters, each
identified from five rig tests of 80 s. For each of them, a bank of random valvings of the virtual damper is drawn;
its laws are their static curves with a lag. `eightpost shapes` searches target curves on the identified car. The best
setup of the bank, the targets and random points of their band are then driven on the true car itself, with the same
laws of the shocks, so that the table shows the errors of the car alone. Gains are shares of the objective with the
predicted best setup of the bank.

Tables: each draw, and the draws of a kind, the worst first. A short version: --seeds 1000:1001 --kinds stand-in.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np

from benchmarks.identification import markdown
from benchmarks.identification_cases import truths_of
from benchmarks.identification_measures import SETTLING, TOTAL
from benchmarks.vehicle_uncertainty_truths import KINDS, REPORT, Outcome, outcome, truth
from builder.build import build
from builder.native.platforms import this_platform
from builder.native.toolchain import Zig
from cosim.study.families import Car, family
from cosim.study.running.sweep import Requested
from cosim.study.running.workers import ProcessWorkers
from cosim.study.study import Build, Drive, Study, Term, Vehicle
from eightpost import units
from eightpost.app.shape_request import Request
from eightpost.app.shape_search import Curves, find_curves
from eightpost.corners import CORNERS
from eightpost.ident.vehicle.fit_validity import with_validity
from eightpost.rig.damper.valves import SHIM_SETS
from eightpost.rig.damper.valving import JETS, Valving
from eightpost.rig.post import Actuators, track_drive
from eightpost.rig.post import Shock as RigShock
from eightpost.shock import Shock, write_shock
from eightpost.shock.shape import Shape
from eightpost.shock.shape_fit import fit_force
from eightpost.signals import TimeSeries, write_parquet
from eightpost.vehicle.storage import write_vehicle

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Row = dict[str, Any]

#: Length of the lap [s], number of random valvings of a bank, number of points of a band that are driven.
LAP, BUILDS, POINTS = 13.0, 6, 12

#: Share of the assured gain that the band keeps [1].
KEPT = Request().keep

#: Numbers of a shape that vary.
VARIED = ("compression.low", "compression.high", "rebound.low", "rebound.high")

#: Highest speed of the curves [m/s]; lag of their laws [s], and force from which the lag is zero [N].
REACH, LAG, LAG_FORCE = 1.0, 0.7e-3, 4325.0

#: Weight and unit of the terms of the objective, and the output whose RMS each is.
OBJECTIVE = {
    "front ride height, RMS": (1000.0, "in", "front.ride_height", "m"),
    "total tire force, RMS": (1.0, "lbf", TOTAL, "N"),
}


def main() -> None:
    """Print the tables."""
    options = _options()
    seeds = REPORT[:6] if options.seeds is None else range(*options.seeds)
    kinds = options.kinds.split(",") if options.kinds else KINDS
    Zig.platforms = (this_platform(),)  # the FMUs run here only
    rows, pool = [], ProcessWorkers(options.workers)
    for seed in seeds:
        for kind in kinds:
            with tempfile.TemporaryDirectory() as folder:
                rows.append(draw(outcome(kind, seed, options.kept), Path(folder), pool))
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    pool.close(wait=True)
    tables = {"draws": rows, "kinds": summary(rows)}
    print(*(markdown(table) for table in tables.values()), sep="\n\n")
    if options.json:
        options.json.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")


# ---- One draw: an identified car, a bank of random valvings, targets, and the truth ---------------------------------


def draw(one: Outcome, folder: Path, pool: ProcessWorkers) -> Row:
    """Return the row of a truth."""
    car = truth(one.kind, one.seed)
    lap = Actuators().follow(track_drive(car, 40000 + one.seed, duration=LAP).series, car)
    shapes = {str(valving): shape_of(valving) for valving in random_valvings(one.seed)}
    bank = {name: folder / f"build_{number}.json" for number, name in enumerate(shapes)}
    for name, path in bank.items():
        write_shock(Shock(name, shapes[name].law()), path)
    study = _study(one, lap, shapes, folder, next(iter(bank.values())))
    requested = Requested(study, folder / "out")
    coupling = requested.coupling(pool)
    found = find_curves(requested, bank, pool, coupling, Request(vary=VARIED, starts=2, seed=one.seed))
    known = requested.everything(coupling)
    laws = {name: shape.law() for name, shape in shapes.items()}
    setups = [known.setup(row).builds for row in range(len(known))]
    builds = [tuple(laws[setup[corner]] for corner in CORNERS) for setup in setups]
    points = [found.optimum.point, *(() if found.band is None else found.band.points[:POINTS])]
    planned = [_laws_at(found, point) for point in points]
    true = np.array([objective_of(measures) for measures in truths_of(car, lap, [*builds, *planned])])
    best = setups.index(dict(found.bank))
    return _row(one, found, true, best, len(builds))


def _row(one: Outcome, found: Curves, true: Array, best: int, count: int) -> Row:
    """Return the row of a truth from true objectives of the bank, the targets and points of the band."""
    in_percent = 100.0 / float(found.reference.nominal[0])
    gains = 100.0 * (true[best] - true) / true[best]
    kept = gains[count + 1 :]
    ends = np.abs(found.optimum.point - 0.5) > 0.49
    return {
        "car": f"{one.kind} {one.seed}",
        "predicted gain, %": in_percent * found.predicted_gain,
        "assured gain, %": in_percent * found.assured_gain,
        "probability of a gain": found.chance,
        "true gain, %": float(gains[count]),
        "true gain over the truly best of the bank, %": float(gains[count] - gains[:count].max()),
        "band, % of each range": 0.0 if found.band is None else 100.0 * found.band.size,
        "points of the band that truly keep it": _of(kept >= KEPT * in_percent * found.assured_gain),
        "lowest true gain in the band, %": float(kept.min()) if kept.size else "",
        "numbers at a limit": _of(ends),
        "trials": found.trials.count,
    }


def _of(flags: Array) -> str:
    return f"{int(flags.sum())} of {flags.size}" if flags.size else ""


def random_valvings(seed: int) -> tuple[Valving, ...]:
    """Return the valvings of a bank: shims AA to D, bleed open by 0 to 14 of 28 clicks, jets up to 0.8 mm2."""
    generator, codes = np.random.default_rng([19, seed]), tuple(SHIM_SETS)
    codes = codes[: codes.index("D") + 1]

    def one() -> Valving:
        compression, rebound, head = (str(generator.choice(codes)) for _ in range(3))
        clicks, jet = int(generator.integers(0, 15)), float(generator.choice(JETS[:5]))
        return Valving(compression, rebound, head, clicks=clicks, jet=jet)

    return tuple(one() for _ in range(BUILDS))


def shape_of(valving: Valving) -> Shape:
    """Return the shape of a valving: its static curve with the lag of the builds of Table 7.3."""
    damper = valving.damper()

    def force(velocity: float) -> float:
        return damper.static_force(velocity) + math.copysign(damper.seals.drag, velocity)

    return replace(fit_force(force, REACH, REACH).shape, lag=LAG, lag_force=LAG_FORCE)


def _study(one: Outcome, lap: TimeSeries, shapes: dict[str, Shape], folder: Path, any_shock: Path) -> Study:
    """Return the study of the identified car, which states its uncertainty as shipped."""
    fit = with_validity(one.fit)
    write_vehicle(folder / "car.json", fit.vehicle)
    write_parquet(lap, folder / "lap.parquet", note="SYNTHETIC lap")
    car, shock = build([folder / "car.json", any_shock], folder / "fmus")
    channels = [f"car.{name}" for name in fit.vehicle.state_space.output_names]
    return Study(
        name=f"{one.kind} {one.seed}",
        vehicle=Vehicle(car.path, means_trusted=False),
        bank={name: Build(shock.path, shape.parameters()) for name, shape in shapes.items()},
        corners=dict.fromkeys(CORNERS, tuple(shapes)),
        drives=(Drive("lap", folder / "lap.parquet", LAP),),
        measures=tuple(m for m in family("ride", Car("car", CORNERS, channels)) if not m.absolute),
        objective=tuple(Term(name, weight, unit) for name, (weight, unit, _, _) in OBJECTIVE.items()),
        alike=(("lf", "rf"), ("lr", "rr")),
        settling=SETTLING,
    )


def _laws_at(found: Curves, point: Array) -> tuple[RigShock, ...]:
    """Return the law at each corner at a point of the search."""
    laws = {corner: shape.law() for group, shape in found.shapes_at(point).items() for corner in group}
    return tuple(laws[corner] for corner in CORNERS)


def objective_of(measures: dict[str, float]) -> float:
    """Return the objective of the measures of a true car."""
    terms = OBJECTIVE.values()
    return float(sum(weight * units.convert(measures[name], own, unit) for weight, unit, name, own in terms))


# ---- All draws ------------------------------------------------------------------------------------------------------


def summary(rows: Sequence[Row]) -> list[Row]:
    """Return the worst, median and best gains of each kind, and how often what is stated is true."""
    found = []
    for kind in dict.fromkeys(row["car"].rpartition(" ")[0] for row in rows):
        own = [row for row in rows if row["car"].startswith(kind)]
        true, predicted, assured = (
            np.array([row[name] for row in own]) for name in ("true gain, %", "predicted gain, %", "assured gain, %")
        )
        found.append(
            {
                "cars": f"{kind}, {len(own)} draws",
                "true gain %, lowest": true.min(),
                "median": float(np.median(true)),
                "highest": true.max(),
                "true - predicted, lowest": (true - predicted).min(),
                "true gain above 0": f"{int((true > 0.0).sum())} of {len(own)}",
                "true gain above the assured one": f"{int((true >= assured).sum())} of {len(own)}",
            }
        )
    return found


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=lambda text: tuple(map(int, text.split(":"))), help="first seed and end, 0:3")
    parser.add_argument("--kinds", help=f"kinds of truths, separated by commas: {', '.join(KINDS)}")
    parser.add_argument("--workers", type=int, default=1, help="number of worker processes (default 1)")
    parser.add_argument("--kept", type=Path, help="keep the identified vehicles in this folder, or read them")
    parser.add_argument("--json", type=Path, help="write the tables to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
