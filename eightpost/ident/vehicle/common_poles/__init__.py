"""Minimal vehicle models in which all paths share the same poles."""

from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleFit, CommonPoleModel, OrderStudy
from eightpost.ident.vehicle.common_poles.deviations import (
    Ranges,
    output_trust,
    ranges_of,
    response_deviation,
    sampled_models,
    spread,
    unmodelled,
)
from eightpost.ident.vehicle.common_poles.refinement import Refinement

__all__ = [
    "CommonPoleFit",
    "CommonPoleModel",
    "OrderStudy",
    "Ranges",
    "Refinement",
    "output_trust",
    "ranges_of",
    "response_deviation",
    "sampled_models",
    "spread",
    "unmodelled",
]
