"""Uncertainty of a fitted shock, as uncertain parameters of its FMU."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from cosim.study.choice.robust_draws import Uncertain
from eightpost.errors import FileFormatError
from eightpost.shock import read_shock
from eightpost.shock.laws import own_parameters


def uncertainty_of(path: str | Path, build: str) -> tuple[Uncertain, tuple[str, ...]]:
    """Return the uncertainty of a fitted shock, and a sentence for each parameter that is kept constant.

    The law's own parameters vary independently by their standard errors, within the fit's bounds. A parameter at a
    bound, or one that the record does not determine, is kept constant. The static curve varies by `compression_scale`
    and `rebound_scale`: its 95 % band is assumed to be fully correlated over all velocities of a side, weighted by
    force, which overstates rather than understates the effect of the band on a measure.

    Args:
        path: Shock file of `eightpost fit`.
        build: Name of the build in the study.

    Raises:
        FileFormatError: The file is not a shock file, or not one that a fit wrote.
    """
    shock = read_shock(path)
    fitted, band = shock.fit.get("parameters"), shock.fit.get("curve_band")
    if not isinstance(fitted, dict) or not isinstance(band, dict):
        raise FileFormatError("states no uncertainty of the shock; fit it with `eightpost fit`", path=path)
    own = {name: fitted[name] for name in own_parameters(type(shock.law)) if name in fitted}
    free = {name: entry for name, entry in own.items() if entry["standard_error"] and not entry["at_bound"]}
    held = tuple(
        f"{build}: {name} is kept at {own[name]['value']:.4g}: {_why(own[name])}" for name in own if name not in free
    )
    scales = dict(_scales(band))
    return Uncertain(
        build,
        (*free, *scales),
        np.array([*(entry["value"] for entry in free.values()), *(1.0 for _ in scales)]),
        np.diag([*(entry["standard_error"] ** 2 for entry in free.values()), *(d**2 for d in scales.values())]),
        np.array([*(_bound(entry, 0) for entry in free.values()), *(0.0 for _ in scales)]),
        np.array([*(_bound(entry, 1) for entry in free.values()), *(inf for _ in scales)]),
    ), held


def _why(entry: dict[str, Any]) -> str:
    return (
        f"the fit ended at its {entry['at_bound']} bound" if entry["at_bound"] else "the record does not determine it"
    )


def _bound(entry: dict[str, Any], side: int) -> float:
    bound = (entry["bounds"] or (None, None))[side]
    return float(bound) if bound is not None else (-inf, inf)[side]


def _scales(band: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the standard deviation of each side's scale: RMS half width of the band over RMS force."""
    velocity, force, half = (np.array(band[f"{name}"]) for name in ("velocity [m/s]", "force [N]", "half_width [N]"))
    reach = float(norm.ppf(0.5 + 0.5 * band["level"]))
    for name, side in (("compression_scale", velocity > 0.0), ("rebound_scale", velocity < 0.0)):
        if side.any() and np.any(force[side]):
            yield name, float(np.sqrt(np.sum(half[side] ** 2) / np.sum(force[side] ** 2))) / reach
