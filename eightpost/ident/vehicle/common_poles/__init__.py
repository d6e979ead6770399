"""Minimal vehicle models whose paths share their poles."""

from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleFit, CommonPoleModel
from eightpost.ident.vehicle.common_poles.refinement import Refinement

__all__ = ["CommonPoleFit", "CommonPoleModel", "Refinement"]
