"""Child process of confined reading: requests from standard input, answers to standard output."""

from __future__ import annotations

import importlib
import os
import pickle
import sys
from pathlib import Path
from typing import Any

from eightpost.confined.channel import receive, send
from eightpost.errors import EightpostError


def serve() -> None:
    """Answer requests until standard input is closed. Output of libraries goes to standard error."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    while True:
        try:
            function, path, options, memory = pickle.loads(receive(sys.stdin.buffer))
        except EOFError:
            return
        send(answers, _packed(_answer(function, path, options, memory)))


def _answer(function: str, path: str, options: tuple[Any, ...], memory: int) -> tuple[str, Any]:
    module, _, name = function.partition(":")
    try:
        read = getattr(importlib.import_module(module), name)
        _limit_memory(memory)
        return "done", read(Path(path), *options)
    except EightpostError as error:
        return "refused", error
    except MemoryError:
        limit = f"{memory / 2**30:.1f} GiB"
        return "failed", f"reading it needs more than {limit} of memory; it is damaged, or export a shorter record"
    except Exception as error:  # libraries raise many types for files that they cannot read
        return "failed", f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _packed(answer: tuple[str, Any]) -> bytes:
    try:
        return pickle.dumps(answer, pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        return pickle.dumps(("failed", f"it contains objects that are not data ({error})"))


def _limit_memory(memory: int) -> None:
    """Limit the address space to the current use plus `memory` [bytes], on systems that support it."""
    try:
        import resource  # noqa: PLC0415
    except ImportError:  # Windows
        return
    try:
        taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    except OSError:
        taken = 4 * 2**30
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = taken + memory
    resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


if __name__ == "__main__":
    serve()
