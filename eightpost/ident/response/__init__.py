"""Estimation of frequency responses from records, and their preconditioning before a model is fitted."""

from eightpost.ident.response.averaged import H1, Recipe, SameDrive, estimate_response
from eightpost.ident.response.conditioning import (
    HighResidual,
    LowResidual,
    Zeroed,
    ZeroPhaseSmoothing,
    condition,
    feedback_paths,
)
from eightpost.ident.response.frequency_response import (
    FrequencyResponse,
    contribution_error,
    read_response,
    response_of,
    write_response,
)
from eightpost.ident.response.local_polynomial import LocalPolynomial
from eightpost.ident.response.records import Blocks, gather

__all__ = [
    "H1",
    "Blocks",
    "FrequencyResponse",
    "HighResidual",
    "LocalPolynomial",
    "LowResidual",
    "Recipe",
    "SameDrive",
    "ZeroPhaseSmoothing",
    "Zeroed",
    "condition",
    "contribution_error",
    "estimate_response",
    "feedback_paths",
    "gather",
    "read_response",
    "response_of",
    "write_response",
]
