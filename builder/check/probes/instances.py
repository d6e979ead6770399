"""Probe of several instances: interleaved, in threads, fifty at once, three hundred one after another."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results, Skip, Values, differ, resident
from builder.check.probes.instance import CallError, Instance
from builder.check.rules import Finding

_MANY, _CYCLES, _WARM = 50, 300, 30
_GROWTH = 1.5e6  # bytes: 5 kB per instance, more than an allocator retains


def probe(bench: Bench) -> Results:
    """Compare the outputs of several instances with those of one alone, and measure memory growth."""
    if bench.description.can("canBeInstantiatedOnlyOncePerProcess"):
        yield Skip("canBeInstantiatedOnlyOncePerProcess is true")
        return
    with bench.running() as instance:
        alone = bench.run(instance, bench.excitation, bench.all_points())
    yield from _interleaved(bench, alone)
    yield from _threads(bench, alone)
    yield from _fifty(bench, alone)
    if sys.platform == "linux":
        yield from _growth(bench)
    else:
        yield Skip("memory is only measured on Linux", "growth")


def _quiet(bench: Bench, time: float) -> Values:
    return bench.excitation(time, -0.4)


def _interleaved(bench: Bench, alone: list[Values]) -> Iterator[Finding]:
    rows = []
    with bench.running() as one, bench.running() as other:
        for point in bench.all_points():
            rows += bench.run(one, bench.excitation, range(point, point + 1))
            bench.run(other, lambda time: _quiet(bench, time), range(point, point + 1))
    if worst := differ(alone, rows):
        yield rules.INSTANCES.finding(
            f"interleaved with another instance, its outputs differ by {worst:.1e} of their size"
        )


def _threads(bench: Bench, alone: list[Values]) -> Iterator[Finding]:
    results: list[list[Values]] = []

    def work(instance: Instance) -> None:
        results.append(bench.run(instance, bench.excitation, bench.all_points()))

    with ExitStack() as stack:
        instances = [stack.enter_context(bench.running()) for _ in range(4)]
        threads = [threading.Thread(target=work, args=(instance,)) for instance in instances]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    if len(results) < 4 or any(differ(alone, rows) for rows in results):
        yield rules.THREADS.finding("the outputs of four instances in threads differ from those of one alone")


def _fifty(bench: Bench, alone: list[Values]) -> Iterator[Finding]:
    try:
        with ExitStack() as stack:
            instances = [stack.enter_context(bench.running()) for _ in range(_MANY)]
            last = [bench.run(instance, bench.excitation, range(min(5, len(alone)))) for instance in instances]
    except CallError as error:
        yield rules.FIFTY.finding(str(error))
        return
    if any(differ(alone[:5], rows) for rows in last):
        yield rules.FIFTY.finding("their outputs differ from those of one alone")


def _growth(bench: Bench) -> Iterator[Finding]:
    def cycle() -> None:
        with bench.running() as instance:
            bench.run(instance, bench.held, range(1))

    for _ in range(_WARM):
        cycle()
    before = resident()
    for _ in range(_CYCLES):
        cycle()
    grown = resident() - before
    if grown > _GROWTH:
        yield rules.GROWTH.finding(f"creating and freeing {_CYCLES} instances leaked {grown / 1e6:.1f} MB")
