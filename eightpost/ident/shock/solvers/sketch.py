"""A first solution on a part of the samples, which determines the shape of the curve and the outliers."""

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
    """Return the problem with which a model of the whole record is sketched."""
    rough = model.dynamics.sketched_on(model)
    return Problem(model) if rough is model else Problem(rough, tolerance=_ROUGH)


@dataclass(frozen=True, slots=True, eq=False)
class Sketch:
    """A minimum on the samples used for sketching a law: a thinned record, if the law is costly.

    Attributes:
        minimum: Minimum on these samples.
        models: Models of the whole record, with the weights used for the minimum.
        order: Order of the inner polynomial.
        tau: Time constant of the best single lag behind the curve [s]; None for a law without lag.
        lpf1: Minimum of LPF1 from which the search started, for a law that has one.
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
        """The force error at the rows (R,) [N], without weights."""
        model = self.minimum.problem.model
        return np.asarray(model.rows(self.minimum.parameters) - model.runs.target)

    @property
    def weights(self) -> Array:
        """The weights of the rows (R,)."""
        return self.models.runs.weights

    @property
    def is_free(self) -> bool:
        """Whether the cubics join the inner polynomial freely."""
        return not self.minimum.problem.model.has_curve_of(self.models("slope", self.order))

    @property
    def whole(self) -> ForceModel:
        """The model on the whole record."""
        return self.models("free" if self.is_free else "slope", self.order)
