"""Probe of the effects of steps on the process: changed locale, text on standard output, memory."""

from __future__ import annotations

import ctypes
import itertools
import locale
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results, Skip, resident, step
from builder.check.probes.instance import CallError, Instance
from builder.check.rules import Finding

_WARM, _BLOCK = 1000, 6000  # steps
_PATIENCE = 5.0  # s
_GROWTH = 3e5  # bytes in each of two blocks: 50 bytes per step, more than an allocator retains


def probe(bench: Bench) -> Results:
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
        yield rules.LOCALE.finding(f"a run changed it from {before!r} to {after!r}")
    if printed:
        text = printed[:80].decode("utf-8", "replace")
        yield rules.PRINTS.finding(
            f"a run of {bench.timing.count} steps printed {len(printed)} bytes, starting with {text!r}"
        )
    yield from _growth(bench) if sys.platform == "linux" else [Skip("memory is only measured on Linux", "memory")]


@contextmanager
def _standard_output() -> Iterator[BinaryIO]:
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


def _read(caught: BinaryIO) -> bytes:
    _flush()
    caught.seek(0)
    return caught.read()


def _flush() -> None:
    """Flush the output buffers of Python and the C library."""
    sys.stdout.flush()
    if sys.platform != "win32":  # on Windows, each library may have its own C runtime
        ctypes.CDLL(None).fflush(None)


def _growth(bench: Bench) -> Iterator[Finding | Skip]:
    """Measure memory over two blocks of steps: memory that is allocated once, e.g. a table, does not grow in both."""
    try:
        with bench.running() as instance:
            done = _walk(bench, instance, range(_WARM))
            sizes = [resident()]
            for _ in range(2):
                done = _walk(bench, instance, range(done, done + _BLOCK))
                sizes.append(resident())
    except CallError as error:
        yield Skip(str(error), "memory over many steps")
        return
    first, second = (after - before for before, after in itertools.pairwise(sizes))
    if min(first, second) > _GROWTH:
        yield rules.STEP_GROWTH.finding(
            f"after {done} steps of one instance the process still grows: by {second / 1e6:.1f} MB in the last block"
        )


def _walk(bench: Bench, instance: Instance, points: range) -> int:
    """Step through points until the time limit; return the first point that was not reached."""
    end = time.monotonic() + _PATIENCE
    for point in points:
        if time.monotonic() > end:
            return point
        bench.drive(instance, bench.excitation(bench.timing.at(point)))
        step(instance, bench.timing.at(point), bench.timing.step)
        instance.reals(bench.outputs)
        instance.messages.clear()  # log messages would count as memory of this process
    return points.stop
