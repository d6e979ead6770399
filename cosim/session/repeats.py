"""Check that a repeated run gives the same bits, for systems with FMUs that this project did not build.

A foreign FMU may keep a state from one run to the next that a new instance does not clear: in memory that the loader
does not free, in a file, on a licence server. Its later runs then silently differ.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.component import Component
from cosim.opened_fmu import OpenedFmu
from cosim.session.setup import Setup
from cosim.system import System
from eightpost.errors import StepError
from eightpost.signals import TimeSeries

#: Number of different runs of one system that are remembered.
_RUNS = 16

#: Odd number, 2^64 divided by the golden ratio: multiplying a channel by an odd multiple of it keeps all of its bits.
_SPREAD = 0x9E3779B97F4A7C15


class _Run(NamedTuple):
    """Hashes of the bits of a run.

    Args:
        times: Hash per row (R,).
        components: Hash of the recorded variables of each component, per row (R,).
    """

    times: NDArray[np.uint64]
    components: Mapping[str, NDArray[np.uint64]]


_known: dict[int, dict[object, _Run]] = {}


def check_repeat(setup: Setup, series: TimeSeries) -> None:
    """Compare a run with the first one of the same system, scenario, algorithm and step, if there is one.

    Args:
        setup: Setup of the run.
        series: Recorded series.

    Raises:
        StepError: The bits differ; the message names the foreign FMUs whose values differ first.
    """
    if all(map(_is_known, setup.system.components.values())):
        return
    runs, run = _runs_of(setup.system), _hashed(series)
    first = runs.setdefault(_key(setup), run)
    if len(runs) > _RUNS:
        del runs[next(iter(runs))]
    if first is not run:
        _compare(setup, series, first, run)


def _is_known(component: Component) -> bool:
    """Return whether a component needs no check: FMUs of eightpost and Python components need none."""
    return not isinstance(component, OpenedFmu) or component.is_ours


def _runs_of(system: System) -> dict[object, _Run]:
    """Return the runs of a system that are remembered, as long as the system exists."""
    if id(system) not in _known:
        _known[id(system)] = {}
        weakref.finalize(system, _known.pop, id(system), None)
    return _known[id(system)]


def _key(setup: Setup) -> object:
    scenario, algorithm = setup.scenario, setup.algorithm
    where = (scenario.stop, scenario.drive_start, tuple(scenario.targets.items()), setup.names)
    return where, scenario.record_step, scenario.drive, repr(algorithm), setup.step


def _hashed(series: TimeSeries) -> _Run:
    components: dict[str, NDArray[np.uint64]] = {}
    for k, name in enumerate(series.names):
        part = name.partition(".")[0]
        bits = series.values[k].view(np.uint64) * np.uint64(_SPREAD * (2 * k + 1) % 2**64)
        components[part] = components[part] + bits if part in components else bits
    return _Run(series.time.view(np.uint64).copy(), components)


def _compare(setup: Setup, series: TimeSeries, first: _Run, run: _Run) -> None:
    count = min(first.times.size, run.times.size)
    pairs = {name: (first.components[name][:count], run.components[name][:count]) for name in run.components}
    differs = {name: np.flatnonzero(a != b) for name, (a, b) in pairs.items()}
    row = min((int(rows[0]) for rows in differs.values() if rows.size), default=count)
    if row == count and first.times.size == run.times.size:
        return
    changed = [name for name, rows in differs.items() if rows.size and rows[0] == row]
    raise StepError(_text(setup, changed, float(series.time[min(row, series.time.size - 1)])))


def _text(setup: Setup, changed: list[str], time: float) -> str:
    foreign = [name for name, component in setup.system.components.items() if not _is_known(component)]
    named = [name for name in foreign if name in changed] or foreign
    files = ", ".join(f"{name!r} ({setup.system.components[name].source})" for name in named)
    return (
        f"this run differs from the last one of the same system, from {time:g} s on: component {files} keeps a state "
        "from run to run, or depends on random numbers or the clock, so none of its results can be trusted; run it "
        "in its own process, which is new for each run: --isolate, IsolatedComponent. If that does not help, "
        "ask its maker"
    )
