"""Identification of shocks from dynamometer tests and of vehicles from rig tests, and validation of both."""

from typing import TYPE_CHECKING, Any

from eightpost.ident.shock.fit import fit_shock
from eightpost.ident.shock.peak_velocity import fit_peak_velocity
from eightpost.ident.shock.result import ShockFit, fit_table, parameter_table
from eightpost.ident.shock.simulation import simulate
from eightpost.ident.validation.shock_tests import Validation, evaluate

if TYPE_CHECKING:
    from eightpost.ident.shock.plots import plot_force_velocity, plot_peak_velocity

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


def __getattr__(name: str) -> Any:
    """Load a function that draws when it is first used: a fit needs no matplotlib, which is an extra."""
    if name in ("plot_force_velocity", "plot_peak_velocity"):
        from eightpost.ident.shock import plots  # noqa: PLC0415 -- see above

        return getattr(plots, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
