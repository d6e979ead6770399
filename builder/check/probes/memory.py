"""Memory use of this process."""

from __future__ import annotations

import gc
import os
from pathlib import Path


def resident() -> int:
    """Return the resident memory of the process in bytes (Linux)."""
    gc.collect()  # callbacks and their instances refer to each other
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
