"""Identification: shocks from dynamometer tests."""

from eightpost.ident.shock import (
    ShockFit,
    Validation,
    evaluate,
    fit_shock,
    fit_table,
    parameter_table,
    plot_force_velocity,
    simulate,
)

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
