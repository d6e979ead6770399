"""Probes of instances and their states: several at once, reset, rollback, effects on the process."""

from __future__ import annotations

import ctypes
import gc
import itertools
import locale
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from builder.check.probes.bench import (
    Bench,
    CallError,
    Instance,
    Results,
    Skip,
    TerminatedError,
    Values,
    compare,
    differ,
    refused,
    set_other_parameters,
)
from builder.check.probes.library import FmuLibrary, MissingFunctionError
from builder.check.rules import Fault, listed, some
from eightpost.workers.process import python_command, run


def _resident() -> int:
    """Return the resident memory of the process in bytes (Linux)."""
    if sys.platform == "linux":
        gc.collect()  # callbacks and their instances refer to each other
        with suppress(AttributeError):  # glibc: what imports left free in the heap would hide the growth of the steps
            ctypes.CDLL(None).malloc_trim(0)
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    raise NotImplementedError(sys.platform)


# ---- Several instances in a process ---------------------------------------------------------------------------------

_MANY, _CYCLES, _WARM_CYCLES = 50, 300, 30
_STACK = 512 * 1024  # bytes: that of threads on macOS, the smallest of the three systems
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


def _interleaved(bench: Bench, alone: list[Values]) -> Iterator[Fault]:
    rows = []
    with bench.running() as one, bench.running() as other:
        for point in bench.all_points():
            rows += bench.run(one, bench.excitation, range(point, point + 1))
            bench.run(other, lambda time: bench.excitation(time, -0.4), range(point, point + 1))
            if point == bench.timing.count // 2:
                with bench.running():
                    pass  # a third one is freed
    if worst := differ(alone, rows):
        yield "instances", f"interleaved with another instance, its outputs differ by {worst:.1e} of their size"


def _threads(bench: Bench, alone: list[Values]) -> Iterator[Fault]:
    results: list[list[Values]] = []

    def work(instance: Instance) -> None:
        results.append(bench.run(instance, bench.excitation, bench.all_points()))

    with ExitStack() as stack:
        instances = [stack.enter_context(bench.running()) for _ in range(4)]
        threads = [threading.Thread(target=work, args=(instance,)) for instance in instances]
        usual, FmuLibrary.place = threading.stack_size(_STACK), f" in a thread with {_STACK // 1024} kB of stack"
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        threading.stack_size(usual)
        FmuLibrary.place = ""
    if len(results) < 4 or any(differ(alone, rows) for rows in results):
        yield "threads", "the outputs of four instances in threads differ from those of one alone"


def _fifty(bench: Bench, alone: list[Values]) -> Iterator[Fault]:
    try:
        with ExitStack() as stack:
            instances = [stack.enter_context(bench.running()) for _ in range(_MANY)]
            last = [bench.run(instance, bench.excitation, range(min(5, len(alone)))) for instance in instances]
    except CallError as error:
        yield "fifty-instances", str(error)
        return
    if any(differ(alone[:5], rows) for rows in last):
        yield "fifty-instances", "their outputs differ from those of one alone"


def _descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def _instance_growth(bench: Bench) -> Iterator[Fault]:
    def cycle() -> None:
        with bench.running() as instance:
            bench.run(instance, bench.held, range(1))
            with suppress(MissingFunctionError):
                instance.call("Reset")

    for _ in range(_WARM_CYCLES):
        cycle()
    before, files = _resident(), _descriptors()
    for _ in range(_CYCLES):
        cycle()
    grown, opened = _resident() - before, _descriptors() - files
    if opened >= _CYCLES // 2:
        yield "descriptors", f"after {_CYCLES} instances {opened} more descriptors are open"
    if grown > _INSTANCE_GROWTH:
        yield "growth", f"creating and freeing {_CYCLES} instances leaked {grown / 1e6:.1f} MB"


# ---- Runs after a reset ---------------------------------------------------------------------------------------------

_STRIDE = 10  # steps
_LATE, _LATE_STEPS = 1.1, 1200  # share of the default experiment, and the smallest number of steps
_RESET_PATIENCE = 1.2  # s of processor time


def probe_reset(bench: Bench) -> Results:
    """Run, disturb, reset, run again: from the middle, from initialization mode, after the end."""
    with bench.instance() as instance:
        first = _whole_run(bench, instance)
        for where in ("between steps", "in initialization mode", "after fmi2Terminate"):
            _disturb(bench, instance, where)
            instance.need("Reset", note=f" {where}")
            yield from _compare(where, first, _whole_run(bench, instance))
            instance.need("Reset")
    yield from _late(bench)


def _late(bench: Bench) -> Iterator[Fault | Skip]:
    """Reset after the default experiment and repeat the run: some defects only occur or show late."""
    most = max(int(_LATE * bench.timing.whole), _LATE_STEPS)
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


def _repeated(bench: Bench, instance: Instance, first: _LongRun) -> Iterator[Fault]:
    where = f"at {bench.timing.at(first.steps):g} s"
    instance.need("Reset", note=f" {where}")
    again = _long_run(bench, instance, first.steps, patient=True)
    if again.refusal is not None:
        yield "reset", f"after fmi2Reset {where} the same run ends earlier: {again.refusal}"
        return
    common = min(len(first.rows), len(again.rows))
    yield from _compare(where, first.rows[:common], again.rows[:common])


def _after_the_end(bench: Bench, instance: Instance) -> Iterator[Fault]:
    """Reset an instance that has ended the simulation itself."""
    try:
        instance.need("Reset", note=" after the FMU ended the simulation")
        bench.initialize(instance)
        bench.run(instance, bench.excitation, range(1))
    except CallError as error:
        yield "reset-ended", str(error)


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
    end = time.process_time() + _RESET_PATIENCE
    try:
        while point < most:
            if point % _STRIDE == 0:
                if not patient and time.process_time() > end:
                    break
                rows.append(instance.reals(bench.outputs))
                bench.drive(instance, bench.excitation(bench.timing.at(point)))
            instance.advance(bench.timing.at(point), bench.timing.step)
            point += 1
    except CallError as error:  # after the end of its experiment an FMU may have no data
        return _LongRun(rows, point, error)
    return _LongRun(rows, point, None)


def _whole_run(bench: Bench, instance: Instance) -> list[Values]:
    bench.initialize(instance)
    return bench.trace(instance, bench.all_points())


def _disturb(bench: Bench, instance: Instance, where: str) -> None:
    """Change parameters, inputs and states of the instance; values that it rejects are ignored."""
    if where == "between steps":  # the instance has just run
        instance.need("Reset")
    bench.enter(instance)
    set_other_parameters(bench, instance, random.Random(1))
    bench.drive(instance, bench.excitation(bench.timing.at(17)))
    if where == "in initialization mode":
        return
    instance.need("ExitInitializationMode")
    bench.run(instance, bench.excitation, range(min(20, bench.timing.count)))
    if where == "after fmi2Terminate":
        instance.need("Terminate")


def _compare(where: str, first: list[Values], second: list[Values]) -> Iterator[Fault]:
    yield from compare(("reset", "reset-bits"), f"after fmi2Reset {where} the same run differs", first, second)


# ---- Effects of steps on the process --------------------------------------------------------------------------------

_WARM_STEPS, _BLOCK_STEPS = 1000, 3000  # steps
_STEP_PATIENCE = 0.8  # s of processor time
_STEP_GROWTH = 1.5e5  # bytes in each of two blocks: 50 bytes per step, more than an allocator retains


def probe_footprint(bench: Bench) -> Results:
    """Compare the process before and after a run, and over many steps."""
    with _standard_output() as caught:
        with bench.running() as instance:
            bench.run(instance, bench.excitation, bench.all_points())
            instance.need("Terminate")
        printed = _read(caught)
    now = process_state()
    for what in dict.fromkeys((*bench.process, *now)) if bench.process else ():
        before, after = (state.get(what, "none") for state in (bench.process, now))
        if after != before:
            rule = "locale" if what == "locale" else "process-state"
            yield rule, f"it changed the {what} from {before} to {after}"
    if printed:
        text = printed[:80].decode("utf-8", "replace")
        text = f"a run of {bench.timing.count} steps printed {len(printed)} bytes, starting with {text!r}"
        yield "standard-output", text
    yield from _step_growth(bench) if sys.platform == "linux" else [Skip("memory is only measured on Linux", "memory")]
    _unload(bench)


def _unload(bench: Bench) -> None:
    """Run a copy of the binary and unload it; what is wrong with that is a crash."""
    own, bench.library = bench.library, bench.library.again()
    with bench.running() as instance:
        bench.run(instance, bench.held, range(1))
    bench.library.unload()
    bench.library = own


def process_state() -> dict[str, str]:
    """Return what belongs to the host: locale, folder, environment, signals, streams, arithmetic."""
    state = {"locale": locale.setlocale(locale.LC_ALL), "working folder": str(Path.cwd())}
    tiny, one = sys.float_info.min, float(len("1"))
    state["small numbers"] = "0" if tiny / 2 == 0.0 else "numbers"
    state["rounding"] = "to nearest" if one + 1e-30 == one == one - 1e-30 and -one - 1e-30 == -one else "in a direction"
    for number, name in enumerate(("standard input", "standard output", "standard error")):
        try:
            status = os.fstat(number)
            state[name] = f"file {status.st_dev}:{status.st_ino}"
        except OSError:
            state[name] = "closed"
    state |= _environment()
    masks = {"SigIgn": "ignored signals", "SigCgt": "handled signals", "SigBlk": "blocked signals"}
    with suppress(OSError):  # Linux
        for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
            name, _, mask = line.partition(":")
            if name in masks:
                state[masks[name]] = listed([str(k + 1) for k in range(64) if int(mask, 16) >> k & 1]) or "none"
            if name == "Umask":
                state["permissions of new files"] = mask.strip()
        if sys.platform != "win32":
            state["alarm"] = "set" if signal.getitimer(signal.ITIMER_REAL)[0] else "none"
        children = Path("/proc/self/task").glob("*/children")
        state["number of child processes"] = str(sum(len(one.read_text(encoding="ascii").split()) for one in children))
    return state


def _environment() -> dict[str, str]:
    """Return the variables of the environment as C functions see them; Python keeps a copy of its own."""
    variables: dict[str, str] = {}
    with suppress(ValueError, OSError):  # Windows has no such variable
        pointer = ctypes.POINTER(ctypes.c_char_p).in_dll(ctypes.CDLL(None), "environ")
        entries: Iterator[bytes] = itertools.takewhile(bool, (pointer[k] for k in itertools.count()))
        for entry in entries if pointer else ():
            name, _, value = entry.decode("utf-8", "replace").partition("=")
            variables[f"environment variable {name}"] = value[:40]
    return variables


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
    sys.stdout.flush()
    if sys.platform != "win32":  # on Windows, each library may have its own C runtime
        ctypes.CDLL(None).fflush(None)


def _step_growth(bench: Bench) -> Iterator[Fault | Skip]:
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
        text = f"after {done} steps of one instance the process still grows: by {second / 1e6:.1f} MB in the last block"
        yield "step-growth", text


def _walk(bench: Bench, instance: Instance, points: range) -> int:
    """Step through points until the time limit; return the first point that was not reached."""
    end = time.process_time() + _STEP_PATIENCE
    for point in points:
        if time.process_time() > end:
            return point
        bench.drive(instance, bench.excitation(bench.timing.at(point)))
        instance.advance(bench.timing.at(point), bench.timing.step)
        instance.reals(bench.outputs)
        instance.messages.clear()  # log messages would count as memory of this process
    return points.stop


# ==== Probes of FMU states: rollback, restoring in other instances and other processes, damaged states ===============

_TIMEOUT = 60.0


def probe_state(bench: Bench) -> Results:
    """Save a state in the middle of a run, continue, restore the state, continue again."""
    if not bench.description.can("canGetAndSetFMUstate"):
        yield Skip("canGetAndSetFMUstate is not true")
        return
    yield from _rollback(bench)
    yield from _start(bench)
    yield from _freed(bench)
    if sys.platform == "linux":
        yield from _state_growth(bench)
    if bench.description.can("canSerializeFMUstate"):
        yield from _serialized(bench)
    else:
        yield Skip("canSerializeFMUstate is not true", "serialized states")


def _halves(bench: Bench) -> tuple[range, range]:
    middle = max(bench.timing.count // 2, 1)
    return range(middle), range(middle, bench.timing.count)


def _rollback(bench: Bench) -> Iterator[Fault]:
    before, after = _halves(bench)
    with bench.running() as instance:
        bench.run(instance, bench.excitation, before)
        state = instance.state()
        first = bench.trace(instance, after)
        for _ in range(2):
            instance.need("SetFMUstate", state)
            yield from _compare_runs("rollback", "after a rollback", first, bench.trace(instance, after))
        instance.call("FreeFMUstate", ctypes.byref(state))


def _start(bench: Bench) -> Iterator[Fault]:
    """Check that a state saved right after initialization restores the start of the run."""
    with bench.running() as instance:
        state = instance.state()
        first = bench.run(instance, bench.excitation, bench.all_points())
        instance.need("SetFMUstate", state)
        again = bench.run(instance, bench.excitation, bench.all_points())
        instance.call("FreeFMUstate", ctypes.byref(state))
        yield from _compare_runs("rollback", "after a rollback to the start", first, again)


def _freed(bench: Bench) -> Iterator[Fault]:
    with bench.running() as instance:
        state = instance.state()
        status = instance.call("FreeFMUstate", ctypes.byref(state))
        if refused(status) or state.value is not None:
            yield "state-freed", "the pointer is not NULL after fmi2FreeFMUstate"
        elif refused(instance.call("FreeFMUstate", ctypes.byref(state), note=" of NULL")):
            yield "state-freed", "fmi2FreeFMUstate of NULL is rejected"


_STATES, _STATE_GROWTH = 1000, 5e4  # states, and bytes in each of two blocks of them


def _state_growth(bench: Bench) -> Iterator[Fault]:
    with bench.running() as instance:
        sizes = []
        for count in (_STATES // 10, _STATES, _STATES):
            for _ in range(count):
                state = instance.state()
                instance.call("FreeFMUstate", ctypes.byref(state))
            sizes.append(_resident())
    if (grown := min(after - before for before, after in itertools.pairwise(sizes))) > _STATE_GROWTH:
        yield "state-growth", f"{_STATES} states that were freed leaked {grown / 1e6:.2f} MB"


def _serialized(bench: Bench) -> Iterator[Fault]:
    before, after = _halves(bench)
    given = [*bench.inputs, *bench.description.of("parameter")]
    with bench.running() as instance:
        bench.run(instance, bench.excitation, before)
        values = [instance.reals(given)]
        state = instance.state()
        content = instance.serialized(state)
        if content != instance.serialized(state) or content != instance.serialized(instance.state()):
            yield "serialized-same", "two serializations of the same state differ"
        first = bench.trace(instance, after)
    with bench.running() as other:  # after the first was freed: some FMUs allow only one instance at a time
        _restore(other, content)
        yield from _compare_runs("serialized-state", "in another instance", values, [other.reals(given)])
        yield from _compare_runs("serialized-state", "in another instance", first, bench.trace(other, after))
    yield from _other_process(bench, content, first)


def _restore(instance: Instance, content: bytes) -> None:
    """Set an instance to a serialized state."""
    status, state = instance.deserialize(content)
    if refused(status):
        raise CallError(
            f"fmi2DeSerializeFMUstate rejected a state that the FMU itself serialized{instance.last_message()}"
        )
    instance.need("SetFMUstate", state)


def _other_process(bench: Bench, content: bytes, first: list[Values]) -> Iterator[Fault]:
    with tempfile.TemporaryDirectory() as folder:
        saved, progress = Path(folder) / "state", Path(folder) / "progress"
        saved.write_bytes(content)
        progress.touch()
        words = (str(bench.folder), str(progress), str(saved), str(bench.timing.count))
        command = python_command("builder.check.probes.instances", *words)
        bench.library.begin("restoring a serialized state in another process")
        ran = run(command, _TIMEOUT)
    if ran.code is None:
        yield "serialized-process", f"restoring did not end within {_TIMEOUT:g} s"
        return
    if ran.code != 0:
        last = ran.errors.decode("utf-8", "replace").strip().splitlines()[-1:] or [f"code {ran.code}"]
        yield "serialized-process", f"restoring failed: {last[0]}"
        return
    rows = [[float.fromhex(word) for word in line.split()] for line in ran.output.decode().splitlines()]
    yield from _compare_runs("serialized-process", "in another process", first, rows)


def _compare_runs(rule: str, where: str, first: list[Values], again: list[Values]) -> Iterator[Fault]:
    yield from compare((rule, "rollback-bits"), f"{where} the same steps differ", first, again)


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
    yield "serialized-corrupt", some(accepted, "accepted: ")


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
        _restore(instance, saved.read_bytes())
        for row in bench.trace(instance, _halves(bench)[1]):
            channel.write(" ".join(value.hex() for value in row) + "\n")
    channel.flush()


if __name__ == "__main__":
    restore(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
    os._exit(0)
