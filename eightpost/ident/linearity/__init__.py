"""Linearity of a car on the rig: the paths that a linear model can predict (dissertation 6.2, Table 6.4)."""

from eightpost.ident.linearity.excitations import Excitation, excitations
from eightpost.ident.linearity.linearity import (
    AmplitudeEffect,
    Condition,
    Linearity,
    Path,
    Thresholds,
    Verdict,
    judge_linearity,
    paths,
)

__all__ = [
    "AmplitudeEffect",
    "Condition",
    "Excitation",
    "Linearity",
    "Path",
    "Thresholds",
    "Verdict",
    "excitations",
    "judge_linearity",
    "paths",
]
