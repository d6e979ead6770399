"""A first solution on a part of the samples, which says how the curve goes and which rows are outliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.solvers.problem import TOLERANCE, Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.force.force_model import ForceModel
    from eightpost.ident.shock.force.models import Models
    from eightpost.ident.shock.solvers.problem import Minimum

    Array = NDArray[np.float64]

#: Tolerance on a thinned record.
_ROUGH = 1e-5


def sketched(model: ForceModel) -> Problem:
    """Return the problem that a model of the whole record is sketched by."""
    rough = model.dynamics.sketched_on(model)
    return Problem(model) if rough is model else Problem(rough, tolerance=_ROUGH)


@dataclass(frozen=True, slots=True, eq=False)
class Sketch:
    """A minimum on the record that a law is sketched on: the thinned one, where the law is costly.

    Attributes:
        minimum: There.
        models: Of the whole record, at the weights that it was found with.
        order: Of the inner polynomial.
        tau: The best single lag behind the curve [s]; None for a law without lag.
        lpf1: The minimum of LPF1 that the search began at, for a law that has one.
    """

    minimum: Minimum
    models: Models
    order: int
    tau: float | None
    lpf1: Minimum | None = None

    @property
    def is_final(self) -> bool:
        """Whether it is a minimum on the whole record."""
        return self.minimum.problem.tolerance == TOLERANCE

    @property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], all weighing alike."""
        model = self.minimum.problem.model
        return np.asarray(model.rows(self.minimum.parameters) - model.runs.target)

    @property
    def weights(self) -> Array:
        """Of the rows (R,)."""
        return self.models.runs.weights

    @property
    def is_free(self) -> bool:
        """Whether its cubics join the inner polynomial freely."""
        return not self.minimum.problem.model.has_curve_of(self.models("slope", self.order))

    @property
    def whole(self) -> ForceModel:
        """The model on the whole record."""
        return self.models("free" if self.is_free else "slope", self.order)
