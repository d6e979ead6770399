"""Identification of shocks from dynamometer tests."""

from eightpost.ident.shock.curve.peak_velocity import fit_peak_velocity
from eightpost.ident.shock.fit import fit_shock
from eightpost.ident.shock.laws.simulation import simulate
from eightpost.ident.shock.report.plots import plot_force_velocity, plot_peak_velocity
from eightpost.ident.shock.report.result import ShockFit
from eightpost.ident.shock.report.tables import fit_table, parameter_table
from eightpost.ident.validation import Validation, evaluate

__all__ = [
    "ShockFit",
    "Validation",
    "evaluate",
    "fit_peak_velocity",
    "fit_shock",
    "fit_table",
    "parameter_table",
    "plot_force_velocity",
    "plot_peak_velocity",
    "simulate",
]
