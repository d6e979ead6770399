"""Uncertainty of a fitted shock, as uncertain parameters of its FMU."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from statistics import NormalDist
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.files import MALFORMED
from eightpost.shock.file import Shock
from eightpost.shock.laws import own_parameters
from eightpost.uncertainty import LeftOutBlocks, left_out_of
from eightpost.validity import ModelUncertainty, ParameterUncertainty


@dataclass(frozen=True, slots=True, eq=False)
class FittedParameters:
    """Parameters of a fitted shock's FMU that are not known exactly. n parameters."""

    names: tuple[str, ...]  #: Names of the parameters.
    values: Array  #: Fitted values (n,).
    covariance: Array  #: Covariance of the parameters (n, n), which are independent.
    lowest: Array  #: Lower limits (n,).
    highest: Array  #: Upper limits (n,).
    held: tuple[str, ...]  #: A sentence for each parameter that is kept constant.
    #: Changes of the parameters when blocks of the test are left out; None if the file does not state them.
    left_out: LeftOutBlocks | None = None


def fitted_parameters(shock: Shock) -> FittedParameters | None:
    """Return the uncertainty that a shock states; None if it states none, because it was not fitted.

    The law's own parameters vary independently by their standard errors, within the fit's bounds. A parameter at a
    bound, or one that the record does not determine, is kept constant. The static curve varies by `compression_scale`
    and `rebound_scale`, whose intervals the fit derives from the covariance of the curve at the velocities of its
    records: errors at different velocities cancel as far as they are independent. A file without these intervals (a
    shock at a setting, or a fit of an earlier version) has the band alone, which is then taken to be fully correlated
    over all velocities of a side, weighted by force. This overstates the effect of the band on a measure.
    """
    fitted, band = shock.fit.get("parameters"), shock.fit.get("curve_band")
    if not isinstance(fitted, dict) or not isinstance(band, dict):
        return None
    own = {name: fitted[name] for law in own_parameters(type(shock.law)) for name in fitted if _is_of(name, law)}
    free = {name: entry for name, entry in own.items() if entry["standard_error"] and not entry["at_bound"]}
    held = tuple(f"{name} is kept at its fitted value: {_why(own[name])}" for name in own if name not in free)
    scales = dict(_scales(band))
    return FittedParameters(
        (*free, *scales),
        np.array([*(entry["value"] for entry in free.values()), *(1.0 for _ in scales)]),
        np.diag([*(entry["standard_error"] ** 2 for entry in free.values()), *(d**2 for d in scales.values())]),
        np.array([*(_bound(entry, 0) for entry in free.values()), *(0.0 for _ in scales)]),
        np.array([*(_bound(entry, 1) for entry in free.values()), *(inf for _ in scales)]),
        held,
        left_out_of(shock.fit) if "factor_half_width" in band else None,
    )


def shock_uncertainty(shock: Shock) -> ModelUncertainty | None:
    """Return the same as parameters that an FMU states; None if the shock states no uncertainty or cannot be read.

    The standard deviation from one copy of the shock to another is that of the builds that were fitted together
    (`fit.between_builds`); without it, it is not known.
    """
    try:
        found = fitted_parameters(shock)
        return None if found is None else _of_fit(found, shock)
    except MALFORMED:
        return None


def _of_fit(found: FittedParameters, shock: Shock) -> ModelUncertainty:
    builds = shock.fit.get("between_builds") or {}
    copies = {name: float(entry["standard_deviation"]) for name, entry in builds.get("parameters", {}).items()}
    deviations = np.sqrt(found.covariance.diagonal())
    rows = zip(found.names, deviations.tolist(), found.lowest.tolist(), found.highest.tolist(), strict=True)
    parameters = tuple(ParameterUncertainty(n, d, copies.get(n), low, high) for n, d, low, high in rows)
    return ModelUncertainty(parameters=parameters, held=found.held, left_out=found.left_out)


def _is_of(name: str, parameter: str) -> bool:
    """Return whether a fitted value is that of a law's parameter, or of one of its elements, such as tau[2]."""
    return name == parameter or name.startswith(f"{parameter}[")


def _why(entry: dict[str, Any]) -> str:
    return (
        f"the fit ended at its {entry['at_bound']} bound" if entry["at_bound"] else "the record does not determine it"
    )


def _bound(entry: dict[str, Any], side: int) -> float:
    bound = (entry["bounds"] or (None, None))[side]
    return float(bound) if bound is not None else (-inf, inf)[side]


def _scales(band: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the standard deviation of each side's factor."""
    reach = NormalDist().inv_cdf(0.5 + 0.5 * band["level"])
    for name, half_width in (band.get("factor_half_width") or dict(_correlated(band))).items():
        yield name, float(half_width) / reach


def _correlated(band: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the half-width of each side's factor if the whole band moves as one: RMS half-width over RMS force."""
    velocity, force, half = (np.array(band[f"{name}"]) for name in ("velocity [m/s]", "force [N]", "half_width [N]"))
    for name, side in (("compression_scale", velocity > 0.0), ("rebound_scale", velocity < 0.0)):
        if side.any() and np.any(force[side]):
            yield name, float(np.sqrt(np.sum(half[side] ** 2) / np.sum(force[side] ** 2)))
