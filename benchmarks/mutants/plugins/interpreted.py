"""Plugin that interprets the loop over coupling steps: compiling it for every mutant takes longer than its tests."""

from __future__ import annotations

from cosim.engine import march
from cosim.engine.march import bound

march.compiled = lambda function, _=None: bound(function)  # type: ignore[attr-defined]
