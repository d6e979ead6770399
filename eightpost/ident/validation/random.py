"""Validation on random tests: the error of Table 3.5 (3.4.1) and an analysis of the residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eightpost.ident.validation.evaluation import evaluate
from eightpost.ident.validation.predicted import Predicted
from eightpost.ident.validation.residual import residual_of

if TYPE_CHECKING:
    from eightpost.ident.validation.evaluation import Validation
    from eightpost.ident.validation.record import Record
    from eightpost.ident.validation.residual import Residual
    from eightpost.shock import Shock


@dataclass(frozen=True, slots=True, eq=False)
class RandomValidation(Predicted):
    """Error of a shock on a random or track record.

    Attributes:
        prediction: Prediction over seconds 1 to 10, or over the segment that `evaluate` chooses.
        residual: Spectra and coherence; None for a record shorter than 2.5 s.
    """

    prediction: Validation
    residual: Residual | None


def validate_random(shock: Shock, record: Record, *, cutoff: float | None = None) -> RandomValidation:
    """Return a shock's error on a random record (Table 3.5)."""
    prediction = evaluate(shock, record.test, cutoff=cutoff)
    return RandomValidation(prediction, residual_of(prediction))
