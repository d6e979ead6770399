"""Rows of the comparison of engines: every engine, scheme, damping and rate."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import inf
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

import cosim
from benchmarks import case as cases
from benchmarks.engines import ours
from benchmarks.engines.drive_fmu import write_drive
from benchmarks.engines.job import Diverged, Job, Recording
from benchmarks.engines.peers import ABSENT, PEERS, Peer, run_peer
from eightpost.shock import Lpnl2
from eightpost.signals import Drivefile

Row = dict[str, Any]

RATES = (125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0)
QUICK_RATES = (125.0, 1000.0, 4000.0)
DAMPINGS = ("full", "split")
RECORD_STEP = 0.008
#: Highest rate of slow engines with --quick [Hz].
SLOW_RATE = 1000.0


@dataclass(frozen=True)
class Bench:
    """The program of the benchmark: rates [Hz], engines (empty: all), dampings, repetitions, and stop time.

    Everything is run in `passes` passes; in each pass, fast engines run `repeats` times. The minimum time counts.
    Several passes are needed because the machine's speed varies: every engine then also runs while it is fast.
    """

    folder: Path
    stop: float
    rates: tuple[float, ...]
    engines: tuple[str, ...] = ()
    dampings: tuple[str, ...] = DAMPINGS
    passes: int = 3
    repeats: int = 3
    quick: bool = False

    def wants(self, engine: str) -> bool:
        """Return whether an engine is selected."""
        return not self.engines or engine in self.engines

    def peers(self) -> tuple[Peer, ...]:
        """Return the peers that are selected and installed."""
        return tuple(peer for peer in PEERS if self.wants(peer.engine) and peer.version)

    def notes(self) -> list[str]:
        """Return notes on how each engine was measured, and which engines were omitted."""
        found = [f"{ours.ENGINE}: {ours.NOTE}."] if self.wants(ours.ENGINE) else []
        found += [f"{peer.engine} {peer.version}: {peer.note}." for peer in self.peers()]
        left = [peer for peer in PEERS if self.wants(peer.engine) and not peer.version]
        found += [f"{peer.engine}: {peer.package} is not installed, so it was omitted." for peer in left]
        found.append(
            f"Every time is the minimum of {self.passes * self.repeats} or more runs in {self.passes} passes over the "
            f"whole table (eightpost runs as often as fits into the time of a slower engine, up to {ours.MOST} times "
            "per pass); slow engines (fmpy-ssp) run once."
        )
        return [*found, *(f"{text}." for text in ABSENT if not self.engines)]


def prepare(bench: Bench) -> Mapping[str, cases.Case]:
    """Build the FMUs and solve the reference for each damping."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        law = cases.fitted_law()
        laws = {"full": (law, 0.0), "split": cases.split_law(law)}
        solved = {damping: pool.submit(_solve, *laws[damping], bench.stop) for damping in bench.dampings}
        found = {damping: one.result() for damping, one in solved.items()}
    for damping, case in found.items():
        cases.build_fmus(case.law, bench.folder / damping, port_damping=case.port_damping)
        write_drive(case.drive, bench.folder / damping)
    return found


def _solve(law: Lpnl2, port_damping: float, stop: float) -> cases.Case:
    return cases.make_case(law, cases.track(), stop, record_step=RECORD_STEP, port_damping=port_damping)


def rows(bench: Bench, solved: Mapping[str, cases.Case], report: Callable[[Row], None]) -> list[Row]:
    """Run everything; `report` is called with every row when it is measured."""
    best: dict[tuple[Any, ...], Row] = {}
    for k in range(bench.passes):
        for found in _measured(bench, solved, is_first=k == 0):
            report(found)
            name = tuple(found[part] for part in ("engine", "scheme", "damping", "rate_hz"))
            if name not in best or _cost(found) < _cost(best[name]):
                best[name] = found
    return list(best.values())


def _measured(bench: Bench, solved: Mapping[str, cases.Case], *, is_first: bool) -> Iterator[Row]:
    for damping, case in solved.items():
        if bench.wants(ours.ENGINE):
            yield from _our_rows(bench, case, damping)
        for peer in bench.peers():
            if is_first or not peer.slow:
                yield from _peer_rows(bench, case, damping, peer)


def _cost(found: Row) -> float:
    return inf if found["us_per_step"] is None else float(found["us_per_step"])


def _our_rows(bench: Bench, case: cases.Case, damping: str) -> Iterator[Row]:
    system, drive, stop = ours.load(bench.folder / damping), case.drive, bench.stop
    warm_up(system, drive)
    for scheme, algorithm in ours.FIXED.items():
        for rate in bench.rates:

            def fixed(algorithm: Any = algorithm, rate: float = rate) -> Recording:
                return ours.run_fixed(system, drive, stop, algorithm, rate, repeats=bench.repeats)

            yield row(case, (ours.ENGINE, scheme, damping, rate), attempt(fixed))
    for scheme, adaptive in ours.ADAPTIVE.items():

        def chosen(adaptive: Any = adaptive) -> Recording:
            return ours.run_adaptive(system, drive, stop, adaptive, repeats=bench.repeats)

        yield row(case, (ours.ENGINE, scheme, damping, None), attempt(chosen))

    def default() -> Recording:
        return ours.run_default(system, drive, stop, repeats=bench.repeats)

    yield row(case, (ours.ENGINE, "default", damping, None), attempt(default))


def warm_up(system: Any, drive: Drivefile) -> None:
    """Compile the loops, or load them from numba's cache."""
    ours.run_fixed(system, drive, 0.04, ours.FIXED["jacobi, held"], 1000.0, repeats=1)
    ours.run_adaptive(system, drive, 0.04, next(iter(ours.ADAPTIVE.values())), repeats=1)


def _peer_rows(bench: Bench, case: cases.Case, damping: str, peer: Peer) -> Iterator[Row]:
    rates = [rate for rate in bench.rates if not (bench.quick and peer.slow and rate > SLOW_RATE)]
    repeats = 1 if peer.slow else bench.repeats
    for scheme in peer.schemes:
        with TemporaryDirectory() as work:
            jobs = [
                Job(str(bench.folder / damping), scheme, rate, bench.stop, mkdtemp(dir=work), repeats) for rate in rates
            ]
            for job, found in zip(jobs, run_peer(peer, jobs), strict=True):
                yield row(case, (peer.engine, scheme, damping, job.rate), found)


def attempt(run: Callable[[], Recording]) -> Recording | Diverged:
    """Run, and return the exception if the run diverges."""
    try:
        return run()
    except Diverged as reason:
        return reason


def row(case: cases.Case, label: tuple[str, str, str, float | None], found: Recording | Diverged) -> Row:
    """Return a row with errors and cost, which are empty for a diverged run."""
    named = dict(zip(("engine", "scheme", "damping", "rate_hz"), label, strict=True))
    if isinstance(found, Diverged):
        print(f"{', '.join(map(str, label))} Hz: {found}", file=sys.stderr)
        return named | dict.fromkeys(("us_per_step", "error_velocity_percent", "error_tire_force_percent"))
    velocity, tire_force = cases.errors(case, found.time, found.values[:4], found.values[4:8])
    is_measured = velocity is not None and found.seconds > 0.0 and found.steps > 0
    return named | {
        "rate_hz": found.rate,
        "us_per_step": 1e6 * found.seconds / found.steps if is_measured else None,
        "error_velocity_percent": velocity,
        "error_tire_force_percent": tire_force,
    }


def measure(case: cases.Case, folder: Path, algorithm: cosim.Algorithm, step: float) -> Row:
    """Run eightpost's engine once; return a row of the table. Errors are None if the run diverged."""

    def once() -> Recording:
        return ours.run_fixed(ours.load(folder), case.drive, case.stop, algorithm, 1.0 / step, repeats=1)

    damping = "split" if case.port_damping else "full"
    return row(case, (ours.ENGINE, algorithm.name, damping, 1.0 / step), attempt(once))
