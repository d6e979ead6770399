"""Identification: shocks from dynamometer tests."""

from eightpost.ident.plots import plot_force_velocity
from eightpost.ident.report import fit_table, parameter_table
from eightpost.ident.shock_fit import ShockFit, fit_shock
from eightpost.ident.simulation import simulate
from eightpost.ident.validation import Validation, evaluate

__all__ = [
    "ShockFit",
    "Validation",
    "evaluate",
    "fit_shock",
    "fit_table",
    "parameter_table",
    "plot_force_velocity",
    "simulate",
]
