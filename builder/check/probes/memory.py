"""How much memory this process holds."""

from __future__ import annotations

import gc
import os
from pathlib import Path


def resident() -> int:
    """Return the bytes of memory that the process holds (Linux)."""
    gc.collect()  # callbacks and their instances hold each other
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
