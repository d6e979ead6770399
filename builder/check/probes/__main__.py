"""Command `python -m builder.check.probes PROBE UNPACKED_FMU PROGRESS_FILE [STEPS]`, which prints JSON lines."""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TextIO

from builder.check.probes.bench import Bench, CallError, Result, Results, Skip, TerminatedError
from builder.check.probes.library import MissingFunctionError
from builder.check.rules import RULES, Finding


def main(name: str, folder: Path, progress: Path, reach: int | None = None) -> None:
    """Run one probe; everything that the FMU itself prints goes to stderr.

    Args:
        name: Module and function of the probe: simulation.probe_steps.
        folder: Folder of the unpacked FMU.
        progress: File for the name of the current call.
        reach: Number of steps after which the FMU ends the simulation itself; None if it does not.
    """
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    module, _, function = name.partition(".")
    probe: Callable[[Bench], Results] = getattr(importlib.import_module(f"builder.check.probes.{module}"), function)
    completed = True
    try:
        bench = Bench(folder, progress, reach)
        try:
            for result in probe(bench):
                _write(channel, _line(result))
        except TerminatedError as error:
            _write(channel, _line(Skip(str(error), "remaining calls")))
        for found in _undeclared(bench):
            _write(channel, _line(found))
    except OSError as error:
        completed = False
        _write(channel, _line(RULES["loads"].finding(str(error))))
    except (CallError, MissingFunctionError) as error:
        completed = False
        _write(channel, _line(RULES["simulates"].finding(str(error))))
    _write(channel, {"completed": True} if completed else {"stopped": True})


def _undeclared(bench: Bench) -> Iterator[Finding]:
    """Yield one finding per undeclared log category, so that findings of several probes are equal."""
    names = {category.decode("utf-8", "replace").strip()[:200] for category in bench.library.categories}
    for name in sorted(names - set(bench.description.categories)):
        yield RULES["log-undeclared"].finding(f"it uses the category {name!r}")


def _line(result: Result) -> dict[str, str]:
    if isinstance(result, Finding):
        return {"rule": result.rule.identifier, "message": result.message}
    if isinstance(result, Skip):
        return {"skipped": result.what, "reason": result.reason}
    return {"value": result.name, "is": result.value}


def _write(channel: TextIO, line: dict[str, str] | dict[str, bool]) -> None:
    channel.write(json.dumps(line) + "\n")
    channel.flush()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), *map(int, sys.argv[4:]))
    os._exit(0)  # skip the exit handlers of loaded libraries, whose errors are not caused by the FMU
