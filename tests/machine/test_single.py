"""Single precision has the results of double precision but for its rounding, with every law and friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from eightpost.machine import LAWS, Port, ShockData
from eightpost.machine.run import STATISTICS
from eightpost.shock import Shock

from .test_kept_batches import CHANGES, FRICTION, ran, shock_of

#: Largest difference of a result, as a share of its size.
ROUNDING = 2e-6


def sizes(name: str, result: Mapping[str, Any]) -> Any:
    """Return what the differences of a result are compared with: those of small sums of large numbers are larger."""
    right = result[name]
    if name.startswith(("channel", "filtered")):
        return np.abs(right).max()
    if name.startswith(("quantity", "statistics")):
        own = dict(zip(STATISTICS, right, strict=True))
        spread = np.sqrt(own["squares"])
        return [own[key] if key in ("squares", "inside") else 10.0 * spread for key in STATISTICS]
    return result["squares"].mean() if name in ("defect", "residual") else np.abs(right).max()


def check(shock: ShockData, port: Port, *, at_rest: bool = False) -> None:
    double, single = (ran(shock, port, at_rest=at_rest, single=single) for single in (False, True))
    for name, right in double.items():
        apart = np.abs(single[name] - right) / np.maximum(np.abs(sizes(name, double)), 1e-9)
        assert apart.max() < ROUNDING, name
    assert any((single[name] != right).any() for name, right in double.items() if name.startswith("channel"))


@pytest.mark.parametrize("name", LAWS)
def test_each_law_has_the_results_of_double_precision(name: str, shocks: Mapping[str, Shock]) -> None:
    for change, values in CHANGES.items():
        check(shock_of(shocks[name], values), Port(0, 0, 1), at_rest=change == "gas")


@pytest.mark.parametrize("kind", FRICTION)
def test_each_friction_has_the_results_of_double_precision(kind: str, shocks: Mapping[str, Shock]) -> None:
    check(shock_of(shocks["lpnl2"], {}), Port(0, 0, 1, FRICTION[kind]))
