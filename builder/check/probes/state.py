"""Probe of FMU states: rollback, restoring in other instances and other processes."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results, Skip, Values, differ
from builder.check.probes.instance import CallError, Instance, refused
from builder.check.rules import Finding, Rule
from eightpost.interpreter import python_command

_TOLERANCE = 1e-9
_TIMEOUT = 60.0


def probe(bench: Bench) -> Results:
    """Save a state in the middle of a run, continue, restore the state, continue again."""
    if not bench.description.can("canGetAndSetFMUstate"):
        yield Skip("canGetAndSetFMUstate is not true")
        return
    yield from _rollback(bench)
    yield from _start(bench)
    yield from _freed(bench)
    if bench.description.can("canSerializeFMUstate"):
        yield from _serialized(bench)
    else:
        yield Skip("canSerializeFMUstate is not true", "serialized states")


def halves(bench: Bench) -> tuple[range, range]:
    """Return the points before and after the middle of a run."""
    middle = max(bench.timing.count // 2, 1)
    return range(middle), range(middle, bench.timing.count)


def _rollback(bench: Bench) -> Iterator[Finding]:
    before, after = halves(bench)
    with bench.running() as instance:
        bench.run(instance, bench.excitation, before)
        state = instance.state()
        there = instance.reals(bench.outputs)
        first = [there, *bench.run(instance, bench.excitation, after)]
        for _ in range(2):
            instance.need("SetFMUstate", state)
            again = [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, after)]
            yield from _compare(rules.ROLLBACK, "after a rollback", first, again)
        instance.call("FreeFMUstate", ctypes.byref(state))


def _start(bench: Bench) -> Iterator[Finding]:
    """Check that a state saved right after initialization restores the start of the run."""
    with bench.running() as instance:
        state = instance.state()
        first = bench.run(instance, bench.excitation, bench.all_points())
        instance.need("SetFMUstate", state)
        again = bench.run(instance, bench.excitation, bench.all_points())
        instance.call("FreeFMUstate", ctypes.byref(state))
        yield from _compare(rules.ROLLBACK, "after a rollback to the start", first, again)


def _freed(bench: Bench) -> Iterator[Finding]:
    with bench.running() as instance:
        state = instance.state()
        status = instance.call("FreeFMUstate", ctypes.byref(state))
        if refused(status) or state.value is not None:
            yield rules.STATE_FREED.finding("the pointer is not NULL after fmi2FreeFMUstate")
        elif refused(instance.call("FreeFMUstate", ctypes.byref(state), note=" of NULL")):
            yield rules.STATE_FREED.finding("fmi2FreeFMUstate of NULL is rejected")


def _serialized(bench: Bench) -> Iterator[Finding]:
    before, after = halves(bench)
    with bench.running() as instance:
        bench.run(instance, bench.excitation, before)
        state = instance.state()
        content = instance.serialized(state)
        if content != instance.serialized(state) or content != instance.serialized(instance.state()):
            yield rules.SAME_BYTES.finding("two serializations of the same state differ")
        first = [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, after)]
    with bench.running() as other:  # after the first was freed: some FMUs allow only one instance at a time
        yield from _compare(rules.SERIALIZED, "in another instance", first, restored(bench, other, content))
    yield from _other_process(bench, content, first)


def restored(bench: Bench, instance: Instance, content: bytes) -> list[Values]:
    """Run the second half from a serialized state; return the outputs at the state and after each step.

    Raises:
        CallError: A call was rejected.
    """
    status, state = instance.deserialize(content)
    if refused(status):
        raise CallError(
            f"fmi2DeSerializeFMUstate rejected a state that the FMU itself serialized{instance.last_message()}"
        )
    instance.need("SetFMUstate", state)
    return [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, halves(bench)[1])]


def _other_process(bench: Bench, content: bytes, first: list[Values]) -> Iterator[Finding]:
    with tempfile.TemporaryDirectory() as folder:
        saved, progress = Path(folder) / "state", Path(folder) / "progress"
        saved.write_bytes(content)
        progress.touch()
        words = (str(bench.folder), str(progress), str(saved), str(bench.timing.count))
        command = python_command("builder.check.probes.restore", *words)
        bench.library.begin("restoring a serialized state in another process")
        try:
            ran = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
        except subprocess.TimeoutExpired:
            yield rules.OTHER_PROCESS.finding(f"restoring did not end within {_TIMEOUT:g} s")
            return
    if ran.returncode != 0:
        last = ran.stderr.strip().splitlines()[-1:] or [f"code {ran.returncode}"]
        yield rules.OTHER_PROCESS.finding(f"restoring failed: {last[0]}")
        return
    rows = [[float.fromhex(word) for word in line.split()] for line in ran.stdout.splitlines()]
    yield from _compare(rules.OTHER_PROCESS, "in another process", first, rows)


def _compare(rule: Rule, where: str, first: list[Values], again: list[Values]) -> Iterator[Finding]:
    worst = differ(first, again) if len(first) == len(again) else float("inf")
    if worst > _TOLERANCE:
        yield rule.finding(f"{where} the same steps differ by {worst:.1e} of the outputs' size")
    elif worst > 0.0:
        yield rules.ROLLBACK_BITS.finding(f"{where} the same steps differ by {worst:.1e}")
