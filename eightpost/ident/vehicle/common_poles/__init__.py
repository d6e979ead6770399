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
from eightpost.ident.vehicle.common_poles.stabilisation import orders_of, plot_stabilisation, stabilisation

__all__ = [
    "CommonPoleFit",
    "CommonPoleModel",
    "OrderStudy",
    "Ranges",
    "Refinement",
    "orders_of",
    "output_trust",
    "plot_stabilisation",
    "ranges_of",
    "response_deviation",
    "sampled_models",
    "spread",
    "stabilisation",
    "unmodelled",
]
