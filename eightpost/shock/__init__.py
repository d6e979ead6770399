"""Shock laws (chapter 3): Polylinear, LPF1, LPNL2. Force from velocity, positive in compression, SI."""

from eightpost.shock.curve import StaticCurve
from eightpost.shock.file import LAWS, Shock, law_name, own_parameters, read_shock, write_shock
from eightpost.shock.law import Response, ShockLaw
from eightpost.shock.lpf1 import Lpf1
from eightpost.shock.lpnl2 import Lpnl2
from eightpost.shock.polylinear import Polylinear
from eightpost.shock.port import Port

__all__ = [
    "LAWS",
    "Lpf1",
    "Lpnl2",
    "Polylinear",
    "Port",
    "Response",
    "Shock",
    "ShockLaw",
    "StaticCurve",
    "law_name",
    "own_parameters",
    "read_shock",
    "write_shock",
]
