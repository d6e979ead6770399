"""The loop over coupling steps is interpreted: compiling it anew for every mutant takes longer than its tests."""

from __future__ import annotations

import sys

sys.modules["numba"] = None  # type: ignore[assignment]
