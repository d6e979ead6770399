"""Probes of FMU states: rollback, restoring in other instances and other processes, damaged states."""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from builder.check.probes.bench import Bench, Results, Skip, Values, compare
from builder.check.probes.instance import CallError, Instance, refused
from builder.check.rules import RULES, Finding, Rule, listed
from eightpost.workers.process import python_command, run

_TIMEOUT = 60.0


def probe_state(bench: Bench) -> Results:
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


def _halves(bench: Bench) -> tuple[range, range]:
    """Return the points before and after the middle of a run."""
    middle = max(bench.timing.count // 2, 1)
    return range(middle), range(middle, bench.timing.count)


def _rollback(bench: Bench) -> Iterator[Finding]:
    before, after = _halves(bench)
    with bench.running() as instance:
        bench.run(instance, bench.excitation, before)
        state = instance.state()
        there = instance.reals(bench.outputs)
        first = [there, *bench.run(instance, bench.excitation, after)]
        for _ in range(2):
            instance.need("SetFMUstate", state)
            again = [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, after)]
            yield from _compare(RULES["rollback"], "after a rollback", first, again)
        instance.call("FreeFMUstate", ctypes.byref(state))


def _start(bench: Bench) -> Iterator[Finding]:
    """Check that a state saved right after initialization restores the start of the run."""
    with bench.running() as instance:
        state = instance.state()
        first = bench.run(instance, bench.excitation, bench.all_points())
        instance.need("SetFMUstate", state)
        again = bench.run(instance, bench.excitation, bench.all_points())
        instance.call("FreeFMUstate", ctypes.byref(state))
        yield from _compare(RULES["rollback"], "after a rollback to the start", first, again)


def _freed(bench: Bench) -> Iterator[Finding]:
    with bench.running() as instance:
        state = instance.state()
        status = instance.call("FreeFMUstate", ctypes.byref(state))
        if refused(status) or state.value is not None:
            yield RULES["state-freed"].finding("the pointer is not NULL after fmi2FreeFMUstate")
        elif refused(instance.call("FreeFMUstate", ctypes.byref(state), note=" of NULL")):
            yield RULES["state-freed"].finding("fmi2FreeFMUstate of NULL is rejected")


def _serialized(bench: Bench) -> Iterator[Finding]:
    before, after = _halves(bench)
    with bench.running() as instance:
        bench.run(instance, bench.excitation, before)
        state = instance.state()
        content = instance.serialized(state)
        if content != instance.serialized(state) or content != instance.serialized(instance.state()):
            yield RULES["serialized-same"].finding("two serializations of the same state differ")
        first = [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, after)]
    with bench.running() as other:  # after the first was freed: some FMUs allow only one instance at a time
        yield from _compare(RULES["serialized-state"], "in another instance", first, _restored(bench, other, content))
    yield from _other_process(bench, content, first)


def _restored(bench: Bench, instance: Instance, content: bytes) -> list[Values]:
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
    return [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, _halves(bench)[1])]


def _other_process(bench: Bench, content: bytes, first: list[Values]) -> Iterator[Finding]:
    with tempfile.TemporaryDirectory() as folder:
        saved, progress = Path(folder) / "state", Path(folder) / "progress"
        saved.write_bytes(content)
        progress.touch()
        words = (str(bench.folder), str(progress), str(saved), str(bench.timing.count))
        command = python_command("builder.check.probes.states", *words)
        bench.library.begin("restoring a serialized state in another process")
        ran = run(command, _TIMEOUT)
    if ran.code is None:
        yield RULES["serialized-process"].finding(f"restoring did not end within {_TIMEOUT:g} s")
        return
    if ran.code != 0:
        last = ran.errors.decode("utf-8", "replace").strip().splitlines()[-1:] or [f"code {ran.code}"]
        yield RULES["serialized-process"].finding(f"restoring failed: {last[0]}")
        return
    rows = [[float.fromhex(word) for word in line.split()] for line in ran.output.decode().splitlines()]
    yield from _compare(RULES["serialized-process"], "in another process", first, rows)


def _compare(rule: Rule, where: str, first: list[Values], again: list[Values]) -> Iterator[Finding]:
    yield from compare((rule, RULES["rollback-bits"]), f"{where} the same steps differ", first, again)


# ---- Damaged serialized states --------------------------------------------------------------------------------------

_PLACES = 12


def probe_corrupt_state(bench: Bench) -> Results:
    """Damage bytes at several places of a serialized state."""
    if not (bench.description.can("canGetAndSetFMUstate") and bench.description.can("canSerializeFMUstate")):
        yield Skip("canSerializeFMUstate is not true")
        return
    with bench.running() as instance:
        bench.run(instance, bench.excitation, _halves(bench)[0])
        content = instance.serialized(instance.state())
    accepted = []
    for what, damaged in _damaged(content):
        with bench.running() as instance:
            bench.library.begin(f"fmi2DeSerializeFMUstate of bytes {what}")
            status, _ = instance.deserialize(damaged)
            accepted += [] if refused(status) else [what]
    if accepted:
        yield RULES["serialized-corrupt"].finding(f"accepted: {listed(accepted)}")


def _damaged(content: bytes) -> Iterator[tuple[str, bytes]]:
    for place in range(0, len(content), max(len(content) // _PLACES, 1)):
        yield f"with byte {place} changed", content[:place] + bytes([content[place] ^ 0x41]) + content[place + 1 :]
    yield "cut in half", content[: len(content) // 2]
    yield "without content", b""
    yield "with bytes appended", content + b"\0" * 8


def restore(folder: Path, progress: Path, saved: Path, reach: int) -> None:
    """Restore a state in a new instance, continue the run, and print the outputs in hexadecimal, a line per point.

    This module run as a program does this for `_other_process`.
    """
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    bench = Bench(folder, progress, reach)
    with bench.running() as instance:
        for row in _restored(bench, instance, saved.read_bytes()):
            channel.write(" ".join(value.hex() for value in row) + "\n")
    channel.flush()


if __name__ == "__main__":
    restore(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
    os._exit(0)
