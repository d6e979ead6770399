"""Constructed studies whose vehicle states its uncertainty, and certainties of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.study.measures import Measure
from cosim.study.result import StudyResult
from eightpost.measure_uncertainty import MeasureUncertainty
from eightpost.model_uncertainty import ModelUncertainty
from eightpost.validity import Validity
from eightpost.verdict import Verdict

from .constructed import Response, result


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
