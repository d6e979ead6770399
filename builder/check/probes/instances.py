"""Probes of instances: several at once, after a reset, and their effects on the process."""

from __future__ import annotations

import ctypes
import gc
import itertools
import locale
import os
import random
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from builder.check.probes.bench import Bench, Results, Skip, Values, compare, differ, set_other_parameters, step
from builder.check.probes.instance import CallError, Instance, TerminatedError
from builder.check.rules import RULES, Finding


def _resident() -> int:
    """Return the resident memory of the process in bytes (Linux)."""
    if sys.platform != "linux":
        raise NotImplementedError(sys.platform)
    gc.collect()  # callbacks and their instances refer to each other
    with suppress(AttributeError):  # glibc: what the imports left free in the heap would hide the growth of the steps
        ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


# ---- Several instances in a process ---------------------------------------------------------------------------------

_MANY, _CYCLES, _WARM_CYCLES = 50, 300, 30
_INSTANCE_GROWTH = 1.5e6  # bytes: 5 kB per instance, more than an allocator retains


def probe_instances(bench: Bench) -> Results:
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
        yield from _instance_growth(bench)
    else:
        yield Skip("memory is only measured on Linux", "growth")


def _interleaved(bench: Bench, alone: list[Values]) -> Iterator[Finding]:
    rows = []
    with bench.running() as one, bench.running() as other:
        for point in bench.all_points():
            rows += bench.run(one, bench.excitation, range(point, point + 1))
            bench.run(other, lambda time: bench.excitation(time, -0.4), range(point, point + 1))
    if worst := differ(alone, rows):
        yield RULES["instances"].finding(
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
        yield RULES["threads"].finding("the outputs of four instances in threads differ from those of one alone")


def _fifty(bench: Bench, alone: list[Values]) -> Iterator[Finding]:
    try:
        with ExitStack() as stack:
            instances = [stack.enter_context(bench.running()) for _ in range(_MANY)]
            last = [bench.run(instance, bench.excitation, range(min(5, len(alone)))) for instance in instances]
    except CallError as error:
        yield RULES["fifty-instances"].finding(str(error))
        return
    if any(differ(alone[:5], rows) for rows in last):
        yield RULES["fifty-instances"].finding("their outputs differ from those of one alone")


def _instance_growth(bench: Bench) -> Iterator[Finding]:
    def cycle() -> None:
        with bench.running() as instance:
            bench.run(instance, bench.held, range(1))

    for _ in range(_WARM_CYCLES):
        cycle()
    before = _resident()
    for _ in range(_CYCLES):
        cycle()
    grown = _resident() - before
    if grown > _INSTANCE_GROWTH:
        yield RULES["growth"].finding(f"creating and freeing {_CYCLES} instances leaked {grown / 1e6:.1f} MB")


# ---- Runs after a reset ---------------------------------------------------------------------------------------------

_STRIDE = 10  # steps
_RESET_PATIENCE, _PROCESSOR_PATIENCE = 40.0, 15.0  # s


def probe_reset(bench: Bench) -> Results:
    """Run, disturb, reset, run again: from the middle, from initialization mode, after the end."""
    with bench.instance() as instance:
        first = _run(bench, instance)
        for where in ("between steps", "in initialization mode", "after fmi2Terminate"):
            _disturb(bench, instance, where)
            instance.need("Reset", note=f" {where}")
            yield from _compare(where, first, _run(bench, instance))
            instance.need("Reset")
    yield from _late(bench)


def _late(bench: Bench) -> Iterator[Finding | Skip]:
    """Reset after twice the default experiment and repeat the run: some defects only occur or show late."""
    most = 2 * bench.timing.whole
    with bench.instance() as instance:
        first = _long_run(bench, instance, most)
        if first.refusal is None:
            yield from _repeated(bench, instance, first)
        elif isinstance(first.refusal, TerminatedError):
            yield from _after_the_end(bench, instance)
    end = bench.timing.at(first.steps)
    if first.refusal is not None:
        with bench.instance() as instance:  # it is reset just before the step that was rejected
            _long_run(bench, instance, first.steps, patient=True)
            yield from _repeated(bench, instance, first)
    if first.steps < most:
        yield Skip(str(first.refusal or "it would take too long"), f"a reset later than {end:g} s")


def _repeated(bench: Bench, instance: Instance, first: _LongRun) -> Iterator[Finding]:
    where = f"at {bench.timing.at(first.steps):g} s"
    instance.need("Reset", note=f" {where}")
    again = _long_run(bench, instance, first.steps, patient=True)
    if again.refusal is not None:
        yield RULES["reset"].finding(f"after fmi2Reset {where} the same run ends earlier: {again.refusal}")
        return
    common = min(len(first.rows), len(again.rows))
    yield from _compare(where, first.rows[:common], again.rows[:common])


def _after_the_end(bench: Bench, instance: Instance) -> Iterator[Finding]:
    """Reset an instance that has ended the simulation itself."""
    try:
        instance.need("Reset", note=" after the FMU ended the simulation")
        bench.initialize(instance)
        bench.run(instance, bench.excitation, range(1))
    except CallError as error:
        yield RULES["reset-ended"].finding(str(error))


@dataclass(frozen=True)
class _LongRun:
    """A run of many steps: outputs at every tenth point, the number of steps, and the error of the last step."""

    rows: list[Values]
    steps: int
    refusal: CallError | None


def _long_run(bench: Bench, instance: Instance, most: int, *, patient: bool = False) -> _LongRun:
    """Step until the time limit, or until a step is rejected; inputs are constant over ten steps."""
    bench.initialize(instance)
    rows: list[Values] = []
    point = 0
    end, processor_end = time.monotonic() + _RESET_PATIENCE, time.process_time() + _PROCESSOR_PATIENCE
    try:
        while point < most:
            if point % _STRIDE == 0:
                if not patient and (time.monotonic() > end or time.process_time() > processor_end):
                    break
                rows.append(instance.reals(bench.outputs))
                bench.drive(instance, bench.excitation(bench.timing.at(point)))
            step(instance, bench.timing.at(point), bench.timing.step)
            point += 1
    except CallError as error:  # after the end of its experiment an FMU may have no data
        return _LongRun(rows, point, error)
    return _LongRun(rows, point, None)


def _run(bench: Bench, instance: Instance) -> list[Values]:
    bench.initialize(instance)
    return [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, bench.all_points())]


def _disturb(bench: Bench, instance: Instance, where: str) -> None:
    """Change parameters, inputs and states of the instance; values that it rejects are ignored."""
    if where == "between steps":  # the instance has just run
        instance.need("Reset")
    bench.enter(instance)
    draw = random.Random(1)
    set_other_parameters(bench, instance, draw)
    bench.drive(instance, bench.excitation(bench.timing.at(17)))
    if where == "in initialization mode":
        return
    instance.need("ExitInitializationMode")
    bench.run(instance, bench.excitation, range(min(20, bench.timing.count)))
    if where == "after fmi2Terminate":
        instance.need("Terminate")


def _compare(where: str, first: list[Values], second: list[Values]) -> Iterator[Finding]:
    yield from compare(
        (RULES["reset"], RULES["reset-bits"]), f"after fmi2Reset {where} the same run differs", first, second
    )


# ---- Effects of steps on the process --------------------------------------------------------------------------------

_WARM_STEPS, _BLOCK_STEPS = 1000, 6000  # steps
_STEP_PATIENCE = 5.0  # s
_STEP_GROWTH = 3e5  # bytes in each of two blocks: 50 bytes per step, more than an allocator retains


def probe_footprint(bench: Bench) -> Results:
    """Compare the process before and after a run, and over many steps."""
    os.environ["LC_ALL"] = "C.UTF-8"  # a call of setlocale(LC_ALL, "") selects it; Python starts with "C"
    before = locale.setlocale(locale.LC_ALL)
    with _standard_output() as caught:
        with bench.running() as instance:
            bench.run(instance, bench.excitation, bench.all_points())
            instance.need("Terminate")
        printed = _read(caught)
    after = locale.setlocale(locale.LC_ALL)
    if after != before:
        yield RULES["locale"].finding(f"a run changed it from {before!r} to {after!r}")
    if printed:
        text = printed[:80].decode("utf-8", "replace")
        yield RULES["standard-output"].finding(
            f"a run of {bench.timing.count} steps printed {len(printed)} bytes, starting with {text!r}"
        )
    yield from _step_growth(bench) if sys.platform == "linux" else [Skip("memory is only measured on Linux", "memory")]


@contextmanager
def _standard_output() -> Iterator[IO[bytes]]:
    """Redirect everything that this process writes to file descriptor 1 into a file."""
    with tempfile.TemporaryFile() as caught:
        _flush()
        kept = os.dup(1)
        os.dup2(caught.fileno(), 1)
        try:
            yield caught
        finally:
            _flush()
            os.dup2(kept, 1)
            os.close(kept)


def _read(caught: IO[bytes]) -> bytes:
    _flush()
    caught.seek(0)
    return caught.read()


def _flush() -> None:
    """Flush the output buffers of Python and the C library."""
    sys.stdout.flush()
    if sys.platform != "win32":  # on Windows, each library may have its own C runtime
        ctypes.CDLL(None).fflush(None)


def _step_growth(bench: Bench) -> Iterator[Finding | Skip]:
    """Measure memory over two blocks of steps: memory that is allocated once, e.g. a table, does not grow in both."""
    try:
        with bench.running() as instance:
            done = _walk(bench, instance, range(_WARM_STEPS))
            sizes = [_resident()]
            for _ in range(2):
                done = _walk(bench, instance, range(done, done + _BLOCK_STEPS))
                sizes.append(_resident())
    except CallError as error:
        yield Skip(str(error), "memory over many steps")
        return
    first, second = (after - before for before, after in itertools.pairwise(sizes))
    if min(first, second) > _STEP_GROWTH:
        yield RULES["step-growth"].finding(
            f"after {done} steps of one instance the process still grows: by {second / 1e6:.1f} MB in the last block"
        )


def _walk(bench: Bench, instance: Instance, points: range) -> int:
    """Step through points until the time limit; return the first point that was not reached."""
    end = time.monotonic() + _STEP_PATIENCE
    for point in points:
        if time.monotonic() > end:
            return point
        bench.drive(instance, bench.excitation(bench.timing.at(point)))
        step(instance, bench.timing.at(point), bench.timing.step)
        instance.reals(bench.outputs)
        instance.messages.clear()  # log messages would count as memory of this process
    return points.stop
