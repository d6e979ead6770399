"""Constructed studies whose vehicle states its uncertainty, and certainties of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.study.choice.certainty import ConfirmedRun, Effect
from cosim.study.measures import Measure
from cosim.study.table import StudyResult
from eightpost.uncertainty import MeasureUncertainty
from eightpost.validity import ModelUncertainty, Validity
from eightpost.verdict import Verdict

from .constructed import Response, result

#: Half-width of the Monte Carlo error of a probability from 4096 draws in 64 groups.
NOISE = 0.03


def lag(build: str, change: float, copies: float = 0.0, corner: str = "rr", measure: str = "a") -> Effect:
    """Return the effect of a parameter of a build on one measure at one corner."""
    return Effect(build, "lag", 1.0, copies, {}, {corner: {build: {measure: change}}})


def paired(first: Effect, second: Effect, correlation: float) -> tuple[Effect, Effect]:
    """Return the effects of the same parameter of two builds whose errors are correlated."""
    there, back = ({one.part: correlation} for one in (second, first))
    return replace(first, correlations=there), replace(second, correlations=back)


def run(setup: int, **values: float) -> ConfirmedRun:
    """Return a rig run of a setup with measured levels."""
    return ConfirmedRun(f"run_{setup}.csv", setup, "lap", f"{setup}", values)


def stating(found: StudyResult, stated: dict[str, tuple[float, float]]) -> StudyResult:
    """Return a result whose vehicle states a common and an own scale by output."""
    measures = {name: MeasureUncertainty(*scales) for name, scales in stated.items()}
    validity = Validity(Verdict([]), (), ModelUncertainty(measures=measures)).to_json()
    return replace(found, provenance=replace(found.provenance, models={"car.fmu": validity}))


def assessed(responses: dict[str, Response], scales: tuple[float, float] = (0.0, 0.5), **fields: object) -> StudyResult:
    """Return a result of which every measure is the RMS of an output `car.o0`, `car.o1` ... with the same scales."""
    found = result(responses, **fields)
    measures = tuple(Measure(name, (f"car.o{k}",)) for k, name in enumerate(responses))
    study = replace(found.study, measures=measures)
    return stating(replace(found, study=study), {f"o{k}": scales for k in range(len(responses))})


def two_setups(difference: float, scales: tuple[float, float] = (0.0, 0.5), **fields: object) -> StudyResult:
    """Return a study of two setups whose only measure differs by a logarithm."""
    corners = {"lf": ("B/B",), "rf": ("B/B",), "lr": ("B/B",), "rr": ("B/B", "C/C")}
    return assessed({"a": lambda digits: np.exp(difference * digits[:, 3])}, scales, corners=corners, **fields)
