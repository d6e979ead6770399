"""This process's parent, and the processors that it may use."""

from __future__ import annotations

import os
import sys
import threading
import time

# ---- Child processes that end when their parent ends, even if the parent is killed ----------------------------------

#: Time between two checks of the parent [s].
_LOOK = 0.5


def end_with(parent: int) -> None:
    """End this process within a second after its parent has ended.

    Args:
        parent: Process number of the parent. It is an argument because, if the parent ended before this call,
            os.getppid() returns another process.
    """
    threading.Thread(target=_end_after, args=(parent,), name="end with parent", daemon=True).start()


def _end_after(parent: int) -> None:
    _wait(parent)
    os._exit(1)


def _wait(parent: int) -> None:
    """Return when the parent has ended."""
    if sys.platform == "win32":
        import ctypes  # noqa: PLC0415 -- only there

        synchronize, forever = 0x00100000, 0xFFFFFFFF
        kernel = ctypes.WinDLL("kernel32")
        kernel.OpenProcess.restype = ctypes.c_void_p
        if handle := kernel.OpenProcess(synchronize, False, parent):
            kernel.WaitForSingleObject(ctypes.c_void_p(handle), forever)
        return
    while os.getppid() == parent:
        time.sleep(_LOOK)


# ---- Number of processors that this process may use -----------------------------------------------------------------


def usable_processors() -> int:
    """Return the number of processors that this process may use; if the system does not report it, all processors."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on Windows and macOS
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1
