"""Benchmark of two friction laws on tests of the stand-in: tanh, which creeps (vehicle FMUs), and a sticking bristle.

    python benchmarks/identification_sticking.py [--duration 200] [--noise 0.01] [--json FILE]

The stand-in's friction is a bristle that sticks and slides. Its force is estimated with the FMU's law, tanh(v / v_f),
for several widths v_f [m/s], and with a bristle that follows the measured velocity, for several reaches [m]. Each row
gives the estimated over the true force, and the mean square that no linear response explains, relative to that without
friction. The second table gives the misfit of the common-pole model in standard deviations of the estimate, with each
law's best width. Noise seeds differ from those reported elsewhere.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np

from benchmarks.identification import markdown
from benchmarks.identification_cases import CASES, Case, records_of
from benchmarks.identification_measures import QUANTITIES
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.friction_search import FrictionSearch
from eightpost.ident.vehicle.port_laws import with_port_laws
from eightpost.ident.vehicle.recipes.common_poles import CommonPoles
from eightpost.rig.post import Car

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.signals import TimeSeries

Row = dict[str, Any]

#: First noise seed of the tests.
_NOISE = 5000


#: Searches by name of the law, each for one of the widths to try.
LAWS: dict[str, tuple[FrictionSearch, ...]] = {
    "tanh(v / v_f)": tuple(FrictionSearch(velocities=(w,), reaches=()) for w in (0.003, 0.006, 0.012, 0.024)),
    "bristle": tuple(
        FrictionSearch(velocities=(), reaches=(w,), static_ratios=(1.0,)) for w in (5e-5, 1e-4, 2e-4, 4e-4)
    ),
}


def main() -> None:
    """Print both tables."""
    options = _options()
    case = replace(CASES["eight_post_known"], duration=options.duration, noise=options.noise)
    tests, experiment = records_of(case, _NOISE)
    sizes, misfits = [], []
    for name, searches in LAWS.items():
        rows = [_found(case, name, tests, experiment, search) for search in searches]
        best = min(rows, key=lambda row: row["unexplained, %"])
        sizes += rows
        misfits.append(_misfit(name, [with_port_laws(test, best["friction"]) for test in tests], experiment))
    print(
        markdown([{k: v for k, v in row.items() if k != "friction"} for row in sizes]), "", markdown(misfits), sep="\n"
    )
    if options.json:
        kept = [{k: v for k, v in row.items() if k != "friction"} for row in sizes]
        options.json.write_text(json.dumps([*kept, *misfits], indent=1) + "\n", encoding="utf-8")


def _found(case: Case, name: str, tests: Sequence[TimeSeries], experiment: Experiment, search: FrictionSearch) -> Row:
    found = search.find(tests, experiment)
    car = case.car
    assert isinstance(car, Car)
    true = dict(zip(car.corners, car.friction.coulomb[:, 0], strict=True))
    return {
        "law": name,
        "width": found.profile[0].width,
        "force, % of true": ", ".join(f"{100.0 * one.value / true[port]:.1f}" for port, one in found.forces.items()),
        "one sigma, %": max(100.0 * one.deviation / true[port] for port, one in found.forces.items()),
        "unexplained, %": 100.0 * float(np.mean(list(found.residual.values()))),
        "friction": found.friction,
    }


def _misfit(name: str, tests: Sequence[TimeSeries], experiment: Experiment) -> Row:
    excess = CommonPoles(friction=None, springs=None, samples=0).explain(tests, experiment).model_fit.excess
    return {"law": name} | {q: max(v for n, v in excess.items() if n.endswith(q)) for q in QUANTITIES}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=200.0, help="duration of each rig test [s]")
    parser.add_argument(
        "--noise", type=float, default=0.01, help="noise relative to each channel's standard deviation [1]"
    )
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
