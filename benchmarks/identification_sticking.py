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
from eightpost.corners import channel
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.friction import FrictionSearch, direction
from eightpost.ident.vehicle.port_laws import bristle_force
from eightpost.ident.vehicle.recipes.common_poles import CommonPoles
from eightpost.rig.post import Car
from eightpost.vehicle import Bristle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.ident.vehicle.friction import Signal
    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]

Row = dict[str, Any]

#: First noise seed of the tests.
_NOISE = 5000


def bristle(velocity: Array, rate: float, reach: float) -> Array:
    """Return the force (N,) of a bristle of 1 N that slides at the reach z_s [m]."""
    return bristle_force(velocity, rate, Bristle(1.0, reach))


#: Laws by name, with the widths to try.
LAWS: dict[str, tuple[Signal, tuple[float, ...]]] = {
    "tanh(v / v_f)": (direction, (0.003, 0.006, 0.012, 0.024)),
    "bristle": (bristle, (5e-5, 1e-4, 2e-4, 4e-4)),
}


def main() -> None:
    """Print both tables."""
    options = _options()
    case = replace(CASES["eight_post_known"], duration=options.duration, noise=options.noise)
    tests, experiment = records_of(case, _NOISE)
    sizes, misfits = [], []
    for name, (signal, widths) in LAWS.items():
        rows = [_found(case, name, tests, experiment, FrictionSearch(velocities=(w,), signal=signal)) for w in widths]
        best = min(rows, key=lambda row: row["unexplained, %"])
        sizes += rows
        misfits.append(_misfit(name, [_rubbed(test, experiment, signal, best) for test in tests], experiment))
    print(markdown([{k: v for k, v in row.items() if k != "forces"} for row in sizes]), "", markdown(misfits), sep="\n")
    if options.json:
        options.json.write_text(json.dumps([*sizes, *misfits], indent=1) + "\n", encoding="utf-8")


def _found(case: Case, name: str, tests: Sequence[TimeSeries], experiment: Experiment, search: FrictionSearch) -> Row:
    found = search.find(tests, experiment)
    car = case.car
    assert isinstance(car, Car)
    true = dict(zip(car.corners, car.friction.coulomb[:, 0], strict=True))
    return {
        "law": name,
        "width": search.velocities[0],
        "force, % of true": ", ".join(f"{100.0 * one.value / true[port]:.1f}" for port, one in found.forces.items()),
        "one sigma, %": max(100.0 * one.deviation / true[port] for port, one in found.forces.items()),
        "unexplained, %": 100.0 * float(np.mean(list(found.residual.values()))),
        "forces": {port: one.value for port, one in found.forces.items()},
    }


def _rubbed(test: TimeSeries, experiment: Experiment, signal: Signal, row: Row) -> TimeSeries:
    """Return a test whose shock forces include the estimated friction."""
    for port in experiment.ports:
        name, velocity = channel(port, "force"), test[channel(port, "velocity")]
        rubbed = row["forces"][port] * signal(velocity, test.sample_rate, row["width"])
        test = test.with_channel(name, "N", test[name] + rubbed)
    return test


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
