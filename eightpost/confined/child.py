"""Child process of confined reading: reads one file after the other within a limit of memory."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

from eightpost.errors import EightpostError
from eightpost.workers.process import ParentChannel


def _answer(request: tuple[str, str, tuple[Any, ...], int]) -> tuple[str, Any]:
    """Call the function of a request; return ("done", result), ("refused", error) or ("failed", message)."""
    function, path, options, memory = request
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


def _unsendable(error: Exception) -> tuple[str, Any]:
    return "failed", f"it contains objects that are not data ({error})"


def _limit_memory(memory: int) -> None:
    """Limit the address space to the current use plus `memory` [bytes], on systems that support it."""
    if sys.platform != "win32":
        import resource  # noqa: PLC0415 -- Windows does not have it

        try:
            taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        except OSError:
            taken = 4 * 2**30
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        wanted = taken + memory
        resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


if __name__ == "__main__":
    ParentChannel(sys.argv[1]).serve(_answer, _unsendable)
