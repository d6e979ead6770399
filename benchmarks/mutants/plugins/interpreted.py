"""Plugin that disables numba: compiling the loop over coupling steps for every mutant takes longer than its tests."""

from __future__ import annotations

import sys

sys.modules["numba"] = None  # type: ignore[assignment]
