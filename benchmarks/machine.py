"""Processor time and error of setups on the machine, beside the same setups through the FMUs.

    python -m benchmarks.machine [--setups N] [--sample N] [--large]

The shipped study (examples/study.toml): seven builds at four corners, a 33 s lap, its measures; then Hysteresis at all
corners, kinds of friction, a quarter car, and the identified car of the examples with friction that sticks. All ways
run in one process in turns: a block of setups on the machine in double and in single precision, then a part of it
through the FMUs; the ratio of these to double precision is the median over the turns. The machine's step is chosen as
for a study. Errors are rms differences from a sixteenth of the step, in percent of the standard deviation, the largest
of eight setups. Compilation and loading are not counted. With --large, 104,976 setups (18 builds at four corners) and a
million of a space of 1000 random builds on a lap of 4 s run on the machine alone, in both precisions.

Prints Markdown. All times are processor times of this machine and this run.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import ROOT, markdown, parser_of
from builder.build import build
from cosim.session.result import difference
from cosim.study import Build, Drive, Measure, Study, Vehicle
from cosim.study.running.batches import Batches
from cosim.study.running.coupling import coupling_for, with_rounding
from cosim.study.running.evaluator import Coupling, Evaluator, MachineCoupling
from cosim.study.study_file import read_study, source_files
from eightpost.corners import CORNERS
from eightpost.shock import Hysteresis, StaticCurve, read_shock, write_shock
from eightpost.virtual.drivefiles import track_drivefile

EXAMPLES = ROOT / "examples"

#: Length of the lap [s], and the seed of its road.
LAP, SEED = 33.0, 11

#: Coupling of runs through the FMUs, which has about the machine's error [s].
THROUGH_FMUS = Coupling("gauss-seidel", 4e-3 / 3.0)

#: Step on the machine where none is chosen [s].
THROUGH_MACHINE = 2e-3

#: Number of setups in a turn, and how many of them also run through the FMUs.
TURN, CHECKED = 48, 4

#: Parameters of the vehicle at every corner, by the kind of friction.
FRICTION: Mapping[str, Mapping[str, float]] = {
    "friction that creeps": {"friction_force": 60.0, "friction_velocity": 0.005},
    "friction that sticks": {"bristle_force": 60.0, "bristle_static_ratio": 1.15},
    "port springs": {"port_spring": 1e5},
}

#: Kinds of outputs of a vehicle whose errors are stated.
KINDS = ("tire_force", "velocity", "hub_acceleration")

HEADS = ("what", "step [ms]", "setups", "double [ms]", "single [ms]", "FMUs [ms]", "ratio", "tire", "velocity", "hub",
         "from FMUs [%]", "single from double [%]")  # fmt: skip


def main() -> None:
    """Measure and print the tables."""
    parser = parser_of(__doc__)
    parser.add_argument("--setups", type=int, default=2401, help="setups of the shipped study")
    parser.add_argument("--sample", type=int, default=192, help="setups of the others")
    parser.add_argument("--large", action="store_true", help="also run large spaces, for some minutes")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        counts = {"shipped study": options.setups}
        rows = ([what, *compare(study, counts.get(what, options.sample))] for what, study in _studies(folder))
        print(markdown(HEADS, rows))
        if options.large:
            study = _shipped_study(folder)
            lap = replace(study.drives[0], stop=4.0)
            measures = tuple(measure for measure in study.measures if measure.section is None)
            short = replace(study, drives=(lap,), measures=measures, objective=(), constraints=())
            print()
            for single in (False, True):
                print(_many(study, 18, 18**4, single=single))
                print(_many(short, 1000, 1_000_000, single=single))


def _studies(folder: Path) -> Iterator[tuple[str, Study]]:
    """Yield studies with their names."""
    study = _shipped_study(folder)
    yield "shipped study", study
    scales = [{"compression_scale": 0.7 + 0.2 * k, "rebound_scale": 1.3 - 0.2 * k} for k in range(4)]
    made = _hysteresis(folder)
    bank = {f"{k}": replace(made, parameters=scale) for k, scale in enumerate(scales)}
    yield "Hysteresis", replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)), baseline={})
    for kind, values in FRICTION.items():
        yield kind, replace(study, vehicle=replace(study.vehicle, parameters=_everywhere(values)))
    quarter, identified = build([EXAMPLES / "corner.toml", EXAMPLES / "identified" / "car.json"], folder / "cars")
    tires = (Measure("tire", ("car.tire_force",)),)
    drive = replace(study.drives[0], targets={"lf.road": "car.road"})
    own = Vehicle(quarter.path, inputs={"aero_force": 0.0})
    one = replace(study, vehicle=own, corners={"corner": tuple(study.bank)}, baseline={}, alike=())
    yield "quarter car", replace(one, measures=tires, drives=(drive,), objective=(), constraints=())
    inputs, friction = {f"{corner}.aero": 0.0 for corner in CORNERS}, _everywhere(FRICTION["friction that sticks"])
    sticking = Vehicle(identified.path, inputs=inputs, parameters=friction)
    road = Drive("track", study.drives[0].file, 33.0, targets={f"{c}.road": f"car.{c}.road" for c in CORNERS})
    velocities = tuple(Measure(f"{c} velocity", (f"car.{c}.velocity",)) for c in CORNERS)
    last = replace(study, vehicle=sticking, measures=velocities, drives=(road,), objective=(), constraints=())
    yield "identified car, friction that sticks", last


def _everywhere(values: Mapping[str, float]) -> dict[str, float]:
    return {f"{corner}.{name}": value for corner in CORNERS for name, value in values.items()}


def _hysteresis(folder: Path) -> Build:
    """Return an FMU of Hysteresis of common size: a curve through knots with the quadratic cells that it needs."""
    shock = read_shock(EXAMPLES / "bank" / "B_B.json")
    velocity = np.array([-1.1, 1.2])[np.repeat([0, 1], [12, 13])] * np.abs(np.linspace(-1.0, 1.0, 25)) ** 1.8
    slope = 1500.0 + 5000.0 / (1.0 + (velocity / 0.1) ** 2)
    force = np.concatenate(([0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(velocity))))
    curve = StaticCurve.through_knots(*(tuple(one.tolist()) for one in (velocity, force - force[12], slope)))
    lagged = tuple(0.6 * one for one in curve.knot_slope)
    law = Hysteresis(curve, lagged, (0.004, 0.001, 0.002), 1e5, 4e-4, 0.01, port=shock.law.port)
    write_shock(replace(shock, law=law), folder / "hysteresis.json")
    return Build(build([folder / "hysteresis.json"], folder / "laws")[0].path)


def compare(study: Study, setups: int) -> list[str]:
    """Return costs and errors of random setups of a study as cells; a note if they cannot run on the machine."""
    evaluator = Evaluator(study)
    coupling = coupling_for(evaluator)
    if coupling.machine is None:
        return [coupling.notes[-1]]
    indices = np.random.default_rng(1).permutation(study.space.indices)[:setups]
    chosen = [study.space.setup(int(index)) for index in indices]
    machine, single = (found := with_rounding(evaluator, coupling)).machine, found.in_single()
    for own in (coupling, single):
        evaluator.rows(chosen[:8], own)
    evaluator.row(chosen[0], THROUGH_FMUS)
    turns = []
    for first in range(0, len(chosen), TURN):
        several = chosen[first : first + TURN]
        clock = [time.process_time()]
        for own in (coupling, single):
            evaluator.rows(several, own)
            clock.append(time.process_time())
        for setup in several[:CHECKED]:
            evaluator.row(setup, THROUGH_FMUS)
        clock.append(time.process_time())
        turns.append(np.diff(clock) / (len(several), len(several), len(several[:CHECKED])))
    own, half, fmu = 1e3 * np.array(turns).T
    times = f"{np.median(own):.2f}", f"{np.median(half):.2f}", f"{np.median(fmu):.1f}", f"{np.median(fmu / own):.0f}"
    errors = (f"{error:.3f}" if error > 0.0 else "" for error in _errors(evaluator, machine, chosen[:8]))
    apart = f"{max(check.difference for check in machine.checks):.2g}"
    rounding = "" if machine.rounding is None else f"{machine.rounding.percent:.2g}"
    return [f"{1e3 * machine.step:.3g}", str(len(chosen)), *times, *errors, apart, rounding]


def _errors(evaluator: Evaluator, machine: MachineCoupling, setups: Sequence[Any]) -> Iterable[float]:
    """Return the largest error of each kind of output [%]; 0 for kinds that the vehicle does not have."""
    study = evaluator.study
    names = [n for n in evaluator.fmus[str(study.vehicle.fmu)].variables if n.rpartition(".")[2] in KINDS]
    recorded = [f"{study.vehicle.name}.{name}" for name in names]
    runs = [Batches(evaluator, step, recorded, measured=False) for step in (machine.step, machine.step / 16.0)]
    worst = dict.fromkeys(KINDS, 0.0)
    for (_, coarse, _), (_, fine, _) in zip(*(batches.runs(setups) for batches in runs), strict=True):
        for drive in study.drives:
            first, second = (
                own[drive.name].channels().window(study.settling, drive.stop) for own in (coarse or {}, fine or {})
            )
            for name, error in difference(first, second).items():
                kind = name.rpartition(".")[2]
                worst[kind] = max(worst[kind], error)
    return worst.values()


def _many(study: Study, builds: int, count: int, *, single: bool) -> str:
    """Return processor time and memory of random setups of random builds on the machine alone, in one precision."""
    rng, some = np.random.default_rng(2), tuple(study.bank.values())
    names = ("compression_scale", "rebound_scale")
    scales = rng.uniform(0.6, 1.6, (builds, 2)).tolist()
    bank = {
        f"{k}": replace(some[k % len(some)], parameters=dict(zip(names, s, strict=True))) for k, s in enumerate(scales)
    }
    space = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)), baseline={})
    batches = Batches(Evaluator(space), THROUGH_MACHINE, single=single)
    indices = range(count) if count == builds**4 else rng.integers(0, builds**4, count)
    began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    done = sum(runs is not None for _, runs, _ in batches.runs(space.space.setup(int(k)) for k in indices))
    seconds = time.process_time() - began
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    what = f"{done} of {count} setups x {study.drives[0].stop:g} s in {'single' if single else 'double'} precision"
    return f"{what}: {seconds:.0f} s of processor time, {grown:.0f} MB more memory"


def _shipped_study(folder: Path) -> Study:
    """Return examples/study.toml on a whole lap; its FMUs are built in the folder."""
    path, lap = EXAMPLES / "study.toml", folder / "lap.parquet"
    track_drivefile(SEED, duration=LAP, rate=500.0).write(lap)
    fmus = {Path(item.source): item.path for item in build(source_files(path), folder / "fmus")}
    study = read_study(path, lambda source: fmus[source])
    names = tuple(study.bank)
    return replace(
        study,
        corners=dict.fromkeys(study.corners, names),
        baseline=dict.fromkeys(study.corners, names[-1]),
        drives=(replace(study.drives[0], file=lap, stop=LAP),),
    )


if __name__ == "__main__":
    main()
