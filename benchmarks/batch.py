"""Processor time of setups in batches against the same setups through the FMUs, and their largest difference.

    python -m benchmarks.batch [--setups N] [--sample N] [--rounds N] [--quick] [--verb] [--json FILE]

The shipped study (benchmarks/study.py): seven builds at four corners, a 33 s lap, its measures. Both engines run in
one process in turns: a block of setups in batches, then a part of it through the FMUs; the ratio of each turn is a
sample of the speed-up, of which the median is printed. Compilation, loading and the choice of the coupling are not
counted. One row per instruction set and mode, then one per law and friction with `--sample` setups. `difference` is
the largest difference of a measure, relative to its value. With --verb the whole verb runs in batches and through the
FMUs.

Prints Markdown; --json writes rows {what, instructions, mode, setups, batch_ms, fmu_ms, ratio, difference}. All times
are processor times of this machine and this run.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.study import ended_processes, shipped_study
from cosim.study import Build, Study, Vehicle
from cosim.study.running.batches import EXACT, FAST
from cosim.study.running.evaluator import Coupling, Evaluator
from cosim.study.running.sweep import run_study
from cosim.study.running.workers import ProcessWorkers
from eightpost.corners import CORNERS
from eightpost.machine import library

#: Coupling step of the shipped study [s].
COUPLING = Coupling("gauss-seidel", 4e-3 / 3.0)

#: Number of setups in a turn, and how many of them also run through the FMUs.
TURN, CHECKED = 48, 8

#: Parameters of the vehicle at every corner, by the kind of friction.
FRICTION: Mapping[str, Mapping[str, float]] = {
    "no friction": {},
    "friction that creeps": {"friction_force": 60.0, "friction_velocity": 0.005},
    "friction that sticks": {"bristle_force": 60.0, "bristle_static_ratio": 1.15},
    "port springs": {"port_spring": 1e5},
}

Row = dict[str, Any]


def main() -> None:
    """Measure and print the tables."""
    options = _options()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study = shipped_study(folder, builds=3 if options.quick else 7)
        found = list(_widths(study, options.setups, options.rounds))
        found += _kinds(study, folder, options.sample)
        print(markdown(found))
        if options.verb:
            print("\n" + "\n".join(_verb(study, folder)))
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _widths(study: Study, setups: int, rounds: int) -> Iterator[Row]:
    """Yield a row for every instruction set of this processor and both modes."""
    widest = library.instruction_set()
    known = {"avx512dq": ("avx512dq", "avx2", ""), "avx2": ("avx2", ""), "": ("",)}[widest]
    for width in known:
        with patch.object(library, "instruction_set", lambda width=width: width):
            for mode in (EXACT, FAST):
                yield {"what": "shipped study", "instructions": width or "all"} | compare(study, setups, mode, rounds)


def _kinds(study: Study, folder: Path, sample: int) -> Iterator[Row]:
    """Yield a row for every law and every friction."""
    for law, build in _laws(folder).items():
        bank = {f"{law} {k}": replace(build, parameters=_scaled(k)) for k in range(4)}
        own = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)), baseline={})
        yield {"what": law, "instructions": library.instruction_set() or "all"} | compare(own, sample, EXACT)
    for kind, values in FRICTION.items():
        parameters = {f"{corner}.{name}": value for corner in CORNERS for name, value in values.items()}
        own = replace(study, vehicle=Vehicle(study.vehicle.fmu, inputs=study.vehicle.inputs, parameters=parameters))
        yield {"what": kind, "instructions": library.instruction_set() or "all"} | compare(own, sample, EXACT)


def _laws(folder: Path) -> dict[str, Build]:
    """Return an FMU of every law, built in the folder, with the curve of a shipped shock."""
    from builder.build import build  # noqa: PLC0415 -- workers import this file and do not need these
    from eightpost.shock import LAWS, Hysteresis, fit_parameters, read_shock, write_shock  # noqa: PLC0415

    shock = read_shock(Path(__file__).resolve().parents[1] / "examples" / "bank" / "B_B.json")
    files = []
    for name, law in LAWS.items():
        if law is Hysteresis:
            made = replace(shock, law=_hysteresis(shock.law.port))
        else:
            values = {p.name: p.start for p in fit_parameters(law)}
            made = replace(shock, law=law(shock.law.curve, port=shock.law.port, **values))
        files.append(folder / f"{name}.json")
        write_shock(made, files[-1])
    return {item.path.stem: Build(item.path) for item in build(files, folder / "laws")}


def _hysteresis(port: Any) -> Any:
    """Return a Hysteresis law of common size: a curve through knots with the quadratic cells that it needs."""
    from eightpost.shock import Hysteresis, StaticCurve  # noqa: PLC0415 -- as above

    velocity = np.array([-1.1, 1.2])[np.repeat([0, 1], [12, 13])] * np.abs(np.linspace(-1.0, 1.0, 25)) ** 1.8
    slope = 1500.0 + 5000.0 / (1.0 + (velocity / 0.1) ** 2)
    force = np.concatenate(([0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(velocity))))
    curve = StaticCurve.through_knots(*(tuple(one.tolist()) for one in (velocity, force - force[12], slope)))
    lagged = tuple(0.6 * one for one in curve.knot_slope)
    return Hysteresis(curve, lagged, (0.004, 0.001, 0.002), 1e5, 4e-4, 0.01, port=port)


def _scaled(k: int) -> dict[str, float]:
    return {"compression_scale": 0.7 + 0.2 * k, "rebound_scale": 1.3 - 0.2 * k}


def compare(study: Study, setups: int, mode: str, rounds: int = 1) -> Row:
    """Return the costs and the largest difference of the first setups of a study, in batches and through the FMUs."""
    evaluator = Evaluator(study)
    coupling = replace(COUPLING, batch=mode)
    chosen = [study.space.setup(int(index)) for index in study.space.indices[:setups]]
    evaluator.rows(chosen[:8], coupling)
    evaluator.row(chosen[0], COUPLING)
    turns, worst = [], 0.0
    for _ in range(rounds):
        for first in range(0, len(chosen), TURN):
            several = chosen[first : first + TURN]
            began = time.process_time()
            found = evaluator.rows(several, coupling)
            middle = time.process_time()
            right = [evaluator.row(setup, COUPLING) for setup in several[:CHECKED]]
            end = time.process_time()
            turns.append(((middle - began) / len(several), (end - middle) / len(right)))
            worst = float(np.max([worst, _difference(study, found, right)]))  # NaN if one is
    batch, fmu = 1e3 * np.array(turns).T
    return {
        "mode": mode,
        "setups": len(chosen),
        "batch_ms": float(np.median(batch)),
        "fmu_ms": float(np.median(fmu)),
        "ratio": float(np.median(fmu / batch)),
        "difference": worst,
    }


def _difference(study: Study, found: Sequence[Row], right: Sequence[Row]) -> float:
    pairs = [(a[m.name], b[m.name]) for a, b in zip(found, right, strict=False) for m in study.measures]
    return float(np.max([abs(a - b) / abs(b) for a, b in pairs if b], initial=0.0))


def _verb(study: Study, folder: Path) -> Iterator[str]:
    """Yield the costs of the whole study in batches and through the FMUs."""
    yield "| engine | setups | wall [s] | processor time of the workers [s] |"
    yield "|---|---|---|---|"
    for engine in ("batch", "fmus"):
        workers = ProcessWorkers(2)
        used, began = ended_processes(), time.perf_counter()
        try:
            if engine == "batch":
                result = run_study(study, folder / engine, workers)
            else:
                result = _through_fmus(study, folder / engine, workers)
        finally:
            workers.close(wait=True)
        yield f"| {engine} | {len(result)} | {time.perf_counter() - began:.1f} | {ended_processes() - used:.1f} |"


def _through_fmus(study: Study, folder: Path, workers: ProcessWorkers) -> Any:
    from cosim.study.running.sweep import Sweep  # noqa: PLC0415 -- as above

    sweep = Sweep(study, folder)
    return sweep.run(workers, replace(sweep.coupling(workers), batch=""))


def markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a table."""
    head = "| what | instructions | mode | setups | batch [ms] | FMUs [ms] | ratio | largest difference |"
    cells = (
        f"| {r['what']} | {r['instructions']} | {r['mode']} | {r['setups']} | {r['batch_ms']:.2f} | "
        f"{r['fmu_ms']:.1f} | {r['ratio']:.1f} | {r['difference']:.1e} |"
        for r in rows
    )
    return "\n".join([head, f"|{'---|' * 8}", *cells])


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--setups", type=int, default=2401, help="setups of the shipped study")
    parser.add_argument("--sample", type=int, default=48, help="setups for each law and friction")
    parser.add_argument("--rounds", type=int, default=1, help="how often all setups run")
    parser.add_argument("--quick", action="store_true", help="three builds: 81 setups")
    parser.add_argument("--verb", action="store_true", help="also run the whole verb both ways")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
