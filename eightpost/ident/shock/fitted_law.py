"""A law fitted to runs, as the comparison of laws uses it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from eightpost.array_types import Array
from eightpost.ident.shock.problem import Solution
from eightpost.ident.shock.robust import downweighted_rows
from eightpost.ident.shock.runs import Runs


@dataclass(frozen=True, slots=True, eq=False)
class FittedLaw(ABC):
    """A law fitted to runs, from which it can be fitted again with other weights."""

    law: str  #: Name of the law.
    notes: tuple[str, ...]  #: Notes on the choices that differ from the dissertation's, without those of the recipe.

    @property
    @abstractmethod
    def runs(self) -> Runs:
        """The runs with the weights of the fit."""

    @property
    @abstractmethod
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""

    @property
    @abstractmethod
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""

    @abstractmethod
    def solution(self) -> Solution:
        """Return the solution with its covariance."""

    @abstractmethod
    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum."""

    def downweighted(self) -> tuple[int, list[str]]:
        """Return the number of samples that were down-weighted as outliers, and a note if there are any."""
        down, rows = downweighted_rows(self.runs.weights), self.runs.weights.size
        samples = round(down * self.runs.measured.size / rows)
        if not samples:
            return 0, []
        return samples, [f"{samples} samples ({100.0 * down / rows:.2g} %) were down-weighted as outliers"]
