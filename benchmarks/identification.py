"""Benchmark of identified vehicles against known cars: accuracy of the predicted response measures of unseen setups.

    python benchmarks/identification.py --case CASE [--quick] [--json FILE] [--methods NAMES] [--setups N] [--seeds N]
        [--car-seed N] [--kept FOLDER]

Cases: quarter_car (twelve unseen shocks), seven_dof_800s, seven_dof_100s (five rig tests of that length, 2 % noise),
eight_post_known (the stand-in, 1 % noise, setups of the seven builds of Table 7.3, the model uses the true laws),
eight_post_fitted (the same with physical dampers, the model uses laws Hysteresis that were fitted to two dynamometer
tests each), eight_post_dampers (the same, but the rig tests have linear dampers), eight_post_close (laws within 10 % of
each other), and flexible_known, flexible_fitted, flexible_dampers, flexible_close: the same for the flexible car, with
its base parameters or those of --car-seed. --quick: the same records, 100 setups.
--kept: keep the true measures and the identified vehicles in a folder; an interrupted run resumes there. Prints
Markdown; --json writes rows {case, method, setups, all_percent, max_percent, spearman_min, kendall_min, seconds}: RMS
and largest error over all RMS
measures and setups, the lowest rank correlations over the measures, and the processor time of the identification.
quarter_car adds mode_frequency_percent, mode_damping_points (the worse of two modes), tire_force_rms_lbf and
tire_force_max_lbf (of the deviations of the tire force's standard deviation over the shocks). --seeds: number of sets
of rig tests with different noise, for the same drive file and true cars; two rows per method, with the worst value and
the median of every figure over the seeds. Seeds are in benchmarks/identification_cases.py.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from time import process_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np
from rich.console import Console
from rich.progress import Progress

from benchmarks.identification_cases import CASES, DRIVE, LAP, Case, noise_seeds, records_of, truths
from benchmarks.identification_measures import Agreement, agreement, measures_of
from benchmarks.identification_methods import methods
from benchmarks.identification_seeds import over_seeds
from eightpost.errors import EightpostError
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.siso_models import RationalFit
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.vehicle import add_port_damping, read_vehicle, shipped

Row = dict[str, Any]
_Tests = Callable[[], tuple[tuple[TimeSeries, ...], Experiment]]
Measures = list[dict[str, float]]

#: Outputs are kept at every fifth sample of 1250 Hz, and this number of setups is simulated at once.
_EVERY, _TOGETHER = 5, 20


def main() -> None:
    """Run one case."""
    options = _options()
    case = CASES[options.case] if options.car_seed is None else replace(CASES[options.case], car_seed=options.car_seed)
    console = Console(stderr=True)
    with Progress(console=console, transient=True) as progress:
        rows = run(case, options, progress)
    text = markdown(rows)
    print(text)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def run(case: Case, options: argparse.Namespace, progress: Progress) -> list[Row]:
    """Return a row per method, or two rows for several seeds; the true measures are computed once."""
    lap, setups = case.lap(), case.chosen(100 if options.quick else options.setups)
    task = progress.add_task(f"{case.name}: {len(setups)} truths (lap {LAP})", total=len(setups))
    true: Measures = []
    for row in kept_truths(case, lap, setups, options.kept):
        true.append(row)
        progress.advance(task)
    judged = _Evaluation(case, lap, setups, true, options.kept)
    chosen = options.methods.split(";") if options.methods else list(methods())
    rows: dict[str, list[Row]] = {name: [] for name in chosen}
    for noise in noise_seeds(options.seeds):
        progress.update(task, description=f"{case.name}: rig tests (drive {DRIVE}, noise from {noise})", total=None)
        tests = cache(partial(records_of, case, noise))
        for name in chosen:
            progress.update(task, description=f"{case.name}: {name}, noise from {noise}")
            rows[name].append(judged.row(name, noise, tests))
            print(f"noise from {noise}: {_line(rows[name][-1])}", file=sys.stderr, flush=True)
    return [row for found in rows.values() for row in (over_seeds(found) if len(found) > 1 else found)]


def kept_truths(
    case: Case, lap: TimeSeries, setups: Sequence[Sequence[int]], folder: Path | None
) -> Iterator[dict[str, float]]:
    """Yield the true measures of setups; those that a folder has are read from it, and the others are added to it."""
    if folder is None:
        yield from truths(case, lap, setups)
        return
    path = folder / f"{case.name}_{case.car_seed}_{LAP}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    known = {tuple(setup): row for setup, row in map(json.loads, lines)}
    missing = iter(truths(case, lap, [setup for setup in setups if tuple(setup) not in known]))
    with path.open("a", encoding="utf-8") as file:
        for setup in setups:
            if tuple(setup) not in known:
                row = next(missing)
                file.write(json.dumps([list(setup), row]) + "\n")
                file.flush()
            else:
                row = known[tuple(setup)]
            yield row


@dataclass(frozen=True, slots=True)
class _Evaluation:
    """The common basis on which methods are evaluated."""

    case: Case  #: Case of the benchmark.
    lap: TimeSeries  #: Motion of the actuators.
    setups: Sequence[Sequence[int]]  #: Index of the shock at each corner, per setup.
    true: Measures  #: True measures of the setups.
    folder: Path | None = None  #: Folder where identified vehicles are kept, None if they are not.

    def row(self, name: str, noise: int, tests: _Tests) -> Row:
        """Return the figures of a method for records; a method that fails has no figures."""
        row: Row = {"case": self.case.name, "method": name, "setups": len(self.true)}
        try:
            fit, seconds = self._identified(name, noise, tests)
            found = self._predicted(fit)
        except EightpostError as error:
            print(f"{name}: {error}", file=sys.stderr)
            return row | dict.fromkeys(Agreement._fields) | {"seconds": None}
        row |= agreement(self.true, found)._asdict() | {"seconds": round(seconds, 2)}
        return row | (_quarter(fit, self.true, found) if self.case.name == "quarter_car" else {})

    def _identified(self, name: str, noise: int, tests: _Tests) -> tuple[VehicleFit, float]:
        """Return the vehicle of a method and the processor time of its identification [s], or read both."""
        label = f"{self.case.name}_{self.case.car_seed}_{noise}_{name.replace(' ', '_')}.pickle"
        kept = None if self.folder is None else self.folder / label
        if kept is not None and kept.exists():
            found: tuple[VehicleFit, float] = pickle.loads(kept.read_bytes())
            return found
        records, experiment = tests()
        started = process_time()
        fit = methods()[name].identify(records, experiment)
        made = fit, process_time() - started
        if kept is not None:
            kept.write_bytes(pickle.dumps(made))
        return made

    def _predicted(self, fit: VehicleFit) -> Measures:
        simulation = ManySetups(fit.vehicle, self.case.laws(), self.lap, _EVERY)
        names, rate = fit.vehicle.state_space.output_names, self.lap.sample_rate / _EVERY
        found: Measures = []
        for k in range(0, len(self.setups), _TOGETHER):
            found += [measures_of(names, y, rate) for y in simulation.run(self.setups[k : k + _TOGETHER])]
        return found


def _quarter(fit: VehicleFit, true: Measures, found: Measures) -> Row:
    wrong = [convert(p["tire_force"] - t["tire_force"], "N", "lbf") for t, p in zip(true, found, strict=True)]
    # The car has the damper of its identification tests, not that of Table 4.1, 16.67 lbf/(in/s).
    car = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), fit.vehicle.baseline_damping)
    modes = sorted({(round(m.frequency_hz, 9), m.damping_ratio) for m in car.modes()})
    pairs = list(zip(modes_of(fit), modes, strict=True))
    return {
        "mode_frequency_percent": max(100.0 * abs(m[0] / t[0] - 1.0) for m, t in pairs),
        "mode_damping_points": max(100.0 * abs(m[1] - t[1]) for m, t in pairs),
        "tire_force_rms_lbf": float(np.sqrt(np.mean(np.square(wrong)))),
        "tire_force_max_lbf": float(np.abs(wrong).max()),
    }


def modes_of(fit: VehicleFit) -> list[tuple[float, float]]:
    """Return frequency [Hz] and damping ratio of both modes, from a fourth-order fit of velocity over road."""
    frequency = np.arange(0.5, 25.0, 0.05)
    model = fit.vehicle.state_space.select(inputs=["road"], outputs=["velocity"])
    path = RationalFit(4, 3).fit(frequency, model.frequency_response(frequency)[0, 0], np.ones_like(frequency))
    return sorted({(round(m.frequency_hz, 9), m.damping_ratio) for m in path.modes()})


def markdown(rows: list[Row]) -> str:
    """Return the rows as a table."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    lines = [f"| {' | '.join(keys)} |", f"|{'---|' * len(keys)}"]
    return "\n".join([*lines, *(f"| {' | '.join(_cell(row.get(key)) for key in keys)} |" for row in rows)])


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4f}" if 0.9 < abs(value) < 1.0 else f"{value:.3g}"
    return "-" if value is None else str(value)


def _line(row: Row) -> str:
    return ", ".join(f"{key} {_cell(value)}" for key, value in row.items())


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=tuple(CASES), required=True)
    parser.add_argument("--quick", action="store_true", help="100 setups")
    parser.add_argument("--setups", type=int, help="maximum number of setups, chosen at random")
    parser.add_argument("--methods", default="", help="methods to run, separated by semicolons (default: all)")
    parser.add_argument("--seeds", type=int, default=1, help="number of sets of rig tests with different noise")
    parser.add_argument("--car-seed", type=int, help="seed of the parameters of the flexible car")
    parser.add_argument("--kept", type=Path, help="keep the true measures in this folder, or read them from it")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
