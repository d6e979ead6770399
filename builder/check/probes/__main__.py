"""Command `python -m builder.check.probes FMU PROGRESS PATIENCE BUDGET REACH GROUP...`, which prints JSON lines."""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TextIO

from builder.check.probes.bench import REACH, Bench, CallError, Measured, Result, Results, Skip, TerminatedError
from builder.check.probes.instances import process_state
from builder.check.probes.library import FmuLibrary, MissingFunctionError
from builder.check.rules import GROUPS, Fault

#: Time that a call may take that uses no processor time [s].
_STILL = 60.0
_LOOK = 0.2  # s


def main(folder: Path, progress: Path, patience: float, budget: float, reach: int | None, groups: list[str]) -> None:
    """Run the probes of groups in turn; everything that the FMU itself prints goes to stderr.

    Args:
        folder: Folder of the unpacked FMU.
        progress: File for the name of the current call.
        patience: Longest processor time of a call [s].
        budget: Processor time for all groups, of which one may take half [s]; the call at its end may take longer.
        reach: Number of steps after which the FMU ends the simulation itself; None if it does not.
        groups: Names of groups. If the first one, `simulation`, fails, the others do not run.
    """
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    errors = os.dup(2)
    os.dup2(errors, 1)
    os.environ["LC_ALL"] = "C.UTF-8"  # a call of setlocale(LC_ALL, "") selects it; Python starts with "C"
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background inherits that it is ignored
    process = process_state()
    threading.Thread(target=_watch, args=(channel, patience, budget), daemon=True).start()
    for group in groups:
        for stream in (1, 2):  # an FMU may have closed it, and the next file would take its place
            os.dup2(errors, stream)
        _write(channel, group=group)
        probe: Callable[[Bench], Results] = getattr(
            importlib.import_module(f"builder.check.probes.{GROUPS[group].module}"), f"probe_{group}"
        )
        completed = True
        for result in _results(probe, folder, progress, reach, process):
            completed &= not isinstance(result, _Stopped)
            reach = int(result.value) if isinstance(result, Measured) and result.name == REACH else reach
            if line := _line(result):
                _write(channel, **line)
        _write(channel, completed=completed)
        if not completed and group == "simulation":
            return


class _Stopped(tuple[str, str]):
    """A fault after which the group cannot go on."""


def _results(probe: Callable[[Bench], Results], *bench_of: Any) -> Iterator[Result]:
    try:
        bench = Bench(*bench_of)
        try:
            yield from probe(bench)
        except TerminatedError as error:
            yield Skip(str(error), "remaining calls")
        yield from _undeclared(bench)
    except OSError as error:
        yield _Stopped(("loads", str(error)))
    except (CallError, MissingFunctionError) as error:
        yield _Stopped(("simulates", str(error)))


def _undeclared(bench: Bench) -> Iterator[Fault]:
    """Yield one finding per undeclared log category, so that findings of several probes are equal."""
    names = {category.decode("utf-8", "replace").strip()[:200] for category in bench.library.categories}
    for name in sorted(names - set(bench.description.categories)):
        yield "log-undeclared", f"it uses the category {name!r}"
    if bench.library.has_mixed:
        yield "log-environment", "an instance called the logger with that of another one"


def _watch(channel: TextIO, patience: float, budget: float) -> None:
    """End the process if a call does not return, or between two calls if groups take too long."""
    call, began, still = -1, 0.0, 0.0
    while True:
        time.sleep(_LOOK)
        busy, now = time.process_time(), time.monotonic()
        if FmuLibrary.calls == call:
            if busy - began > patience or now - still > _STILL:
                limit = f"{patience:g} s of processor time" if busy - began > patience else f"{_STILL:g} s"
                _write(channel, hung=limit, used=busy)
                os._exit(1)
            continue
        call, began, still = FmuLibrary.calls, busy, now
        if busy > budget or busy - _started > 0.5 * budget:
            _write(channel, skipped="remaining calls", reason="they would take too much processor time")
            _write(channel, completed=True, used=busy)
            os._exit(1)


_started = 0.0


def _line(result: Result) -> dict[str, Any]:
    if isinstance(result, Skip):
        return {"skipped": result.what, "reason": result.reason}
    if isinstance(result, Measured):
        return {"value": result.name, "is": result.value}
    rule, message = result
    return {"rule": rule, "message": message} if message else {}


def _write(channel: TextIO, **line: Any) -> None:
    global _started  # noqa: PLW0603 - the time at which the current group began
    if "group" in line:
        _started = time.process_time()
    channel.write(json.dumps(line) + "\n")
    channel.flush()


if __name__ == "__main__":
    words = sys.argv[1:]
    steps = int(words[4]) if words[4] else None
    main(Path(words[0]), Path(words[1]), float(words[2]), float(words[3]), steps, words[5:])
    os._exit(0)  # skip the exit handlers of loaded libraries, whose errors are not caused by the FMU
