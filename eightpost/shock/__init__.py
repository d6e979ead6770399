"""Shock laws (chapter 3 and more). Force over velocity, positive in compression, SI units."""

from eightpost.shock.curve import CurveNumbers, StaticCurve
from eightpost.shock.file import Shock, read_shock, write_shock
from eightpost.shock.hysteresis import Hysteresis
from eightpost.shock.law import FitParameter, Piece, Port, Response, ShockLaw, Valve
from eightpost.shock.laws import (
    LAWS,
    fit_form,
    fit_parameters,
    law_module,
    law_name,
    law_title,
    own_parameters,
    own_values,
    parameter_units,
    state_names,
)
from eightpost.shock.lpf1 import Lpf1
from eightpost.shock.lpnl2 import Lpnl2
from eightpost.shock.polylinear import Polylinear
from eightpost.shock.settings import Axis, Settings, Term

__all__ = [
    "LAWS", "Axis", "CurveNumbers", "FitParameter", "Hysteresis", "Lpf1", "Lpnl2", "Piece", "Polylinear", "Port",
    "Response", "Settings", "Shock", "ShockLaw", "StaticCurve", "Term", "Valve", "fit_form", "fit_parameters",
    "law_module", "law_name", "law_title", "own_parameters", "own_values", "parameter_units", "read_shock",
    "state_names", "write_shock",
]  # fmt: skip
