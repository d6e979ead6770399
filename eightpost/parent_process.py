"""Child processes that end with their parent, even if the parent was killed: nobody waits for their work."""

from __future__ import annotations

import os
import sys
import threading
import time

#: Time between two looks at the parent [s].
_LOOK = 0.5


def end_with(parent: int) -> None:
    """End this process within a second after its parent has ended.

    Args:
        parent: Process number of the parent. It is given because a parent that ended before this call has another
            process in its place.
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
