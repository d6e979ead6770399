"""Figures of a prediction over a whole record, common to random and sine records."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eightpost.ident.validation.evaluation import Validation


class Predicted:
    """A result with a `prediction` over a whole record."""

    __slots__ = ()
    prediction: Validation

    @property
    def rms(self) -> float:
        """The RMS of the error [N]."""
        return self.prediction.rms

    @property
    def percent(self) -> float:
        """The error in percent of this record's standard deviation of force."""
        return self.prediction.percent

    @property
    def beyond(self) -> float:
        """Share of the samples outside the fitted velocities [1]."""
        return self.prediction.beyond
