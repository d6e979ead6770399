"""Cost of the study of 2401 setups in other engines, compared with ours and the dissertation's 20 hours.

One setup of the study (its baseline) runs in a loop over fmpy and in libcosim (benchmarks/engines): the same FMUs, the
same lap, values exchanged at the start of each step and held, as both engines do. The time of the loop alone is
measured, without loading, with recording of ten outputs and four forces; all other costs of a study are neglected in
their favour. Errors are relative to our own run at an eighth of the study's step, like those of the study's rows: of
shock velocities and tire forces, worst corner, in percent of the standard deviation. The exchange is of first order, so
the rate that would meet the study's accuracy is computed from the error at the finest rate; time is proportional to the
rate.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.engines.drive_fmu import write_drive
from benchmarks.engines.job import CORNERS, Diverged, Job, Recording
from benchmarks.engines.peers import PEERS, run_peer
from cosim.study import StudyResult
from cosim.study.running.evaluator import Evaluator, coupling_of
from eightpost.signals import Drivefile, TimeSeries

Array = NDArray[np.float64]

#: Engines to run, and their rates [Hz].
ENGINES, RATES = ("fmpy", "libcosim"), (1000.0, 4000.0)

#: Error above which a run counts as diverged [%].
_LOST = 100.0

#: Time of a setup estimated in the dissertation (Table 7.1: 20 hours for 2401) [s].
DISSERTATION = 30.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one setup in an engine."""

    engine: str  #: Name of the engine.
    rate: float  #: Coupling steps per second [Hz].
    error: float | None  #: Larger of the errors of shock velocity and tire force [%]; None if the run diverged.
    seconds: float  #: Wall time of the steps [s].

    def at(self, accuracy: float) -> Cost | None:
        """Return the cost at the rate at which a first-order scheme has this error [%]; None if the run diverged."""
        if self.error is None:
            return None
        more = max(self.error / accuracy, 1.0)
        return replace(self, rate=more * self.rate, error=self.error / more, seconds=more * self.seconds)


def peer_costs(result: StudyResult, folder: Path, rates: Sequence[float] = RATES) -> Iterator[Cost]:
    """Run the baseline of a study in the installed engines and yield the costs."""
    fine = _reference(result)
    _write_inputs(result, folder)
    for peer in (peer for peer in PEERS if peer.engine in ENGINES and peer.version):
        works = {rate: folder / f"{peer.module}_{rate:g}" for rate in rates}
        for work in works.values():
            work.mkdir()
        jobs = [
            Job(str(folder), peer.schemes[0], rate, float(fine.time[-1]), str(work)) for rate, work in works.items()
        ]
        for job, found in zip(jobs, run_peer(peer, jobs), strict=True):
            yield _cost(peer.engine, job.rate, found, fine.window(result.study.settling, fine.time[-1]))


def _cost(engine: str, rate: float, found: Recording | Diverged, fine: TimeSeries) -> Cost:
    if isinstance(found, Diverged):
        return Cost(engine, rate, None, float("nan"))
    at = np.searchsorted(found.time, fine.time - 1e-7)
    return Cost(engine, rate, _error(found.values[:8, np.minimum(at, found.time.size - 1)], fine.values), found.seconds)


def _error(found: Array, fine: Array) -> float | None:
    """Return the largest error of a signal [%] of its standard deviation; None if the run diverged."""
    worst = float(np.max(100.0 * np.sqrt(np.mean((found - fine) ** 2, axis=1)) / np.std(fine, axis=1)))
    return worst if worst < _LOST else None


def _reference(result: StudyResult) -> TimeSeries:
    """Return shock velocities and tire forces of the baseline at an eighth of the study's step."""
    study, coupling = result.study, coupling_of(result)
    evaluator, drive = Evaluator(study), study.drives[0]
    names = [f"{study.vehicle.name}.{c}.{what}" for what in ("velocity", "tire_force") for c in CORNERS]
    setup = study.space.find(study.baseline)
    fine = evaluator.run(setup, drive, replace(coupling, step=coupling.step / 8.0), extra=names).series
    return fine.select(names)


def _write_inputs(result: StudyResult, folder: Path) -> None:
    """Write the engines' input files: car.fmu, shock.fmu and the drive."""
    folder.mkdir(parents=True, exist_ok=True)
    builds = set(result.study.baseline.values())
    shutil.copy(result.study.vehicle.fmu, folder / "car.fmu")
    shutil.copy(result.study.bank[builds.pop()].fmu, folder / "shock.fmu")
    write_drive(Drivefile.read(result.study.drives[0].file), folder)


def markdown(costs: Sequence[Cost], ours: Cost, accuracy: float, setups: int, workers: int) -> str:
    """Return the costs as a table; the time of all setups is that of one, divided among the workers without loss."""
    head = f"| | rate [Hz] | error [%] | a setup [s] | {setups} setups, {workers} workers |"
    lines = [head, "|---" * 5 + "|", _line("eightpost study, measured as a whole", ours, setups, workers)]
    for cost in costs:
        lines.append(_line(f"{cost.engine}, held values", cost, setups, workers))
    finest = {cost.engine: cost.at(accuracy) for cost in costs if cost.error is not None}
    lines += [
        _line(f"{name}, at that accuracy (by first order)", c, setups, workers) for name, c in finest.items() if c
    ]
    last = f"| dissertation (Table 7.1, estimated) | | | {DISSERTATION:g} | {_duration(DISSERTATION * setups)} |"
    return "\n".join([*lines, last])


def _line(name: str, cost: Cost, setups: int, workers: int) -> str:
    if cost.error is None:
        return f"| {name} | {cost.rate:.0f} | diverges | | |"
    whole = cost.seconds * setups / workers
    return f"| {name} | {cost.rate:.0f} | {cost.error:.2g} | {cost.seconds:.3g} | {_duration(whole)} |"


def _duration(seconds: float) -> str:
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
