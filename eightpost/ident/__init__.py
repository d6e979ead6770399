"""Identification: shocks from dynamometer tests."""

from eightpost.ident.shock.fit import ShockFit, fit_shock
from eightpost.ident.shock.plots import plot_force_velocity
from eightpost.ident.shock.report import fit_table, parameter_table
from eightpost.ident.shock.simulation import simulate
from eightpost.ident.shock.validation import Validation, evaluate

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
