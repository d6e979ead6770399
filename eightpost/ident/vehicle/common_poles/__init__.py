"""Minimal vehicle models in which all paths share the same poles."""

from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleFit, CommonPoleModel, OrderStudy, refitted
from eightpost.ident.vehicle.common_poles.deviations import (
    output_trust,
    response_deviation,
    sampled_models,
    spread,
    unmodelled,
)
from eightpost.ident.vehicle.common_poles.refinement import Refinement
from eightpost.ident.vehicle.ranges import Ranges

__all__ = [
    "CommonPoleFit",
    "CommonPoleModel",
    "OrderStudy",
    "Ranges",
    "Refinement",
    "output_trust",
    "refitted",
    "response_deviation",
    "sampled_models",
    "spread",
    "unmodelled",
]
