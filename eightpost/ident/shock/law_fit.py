"""One law fitted to prepared runs by the joint recipe, with outliers down-weighted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from eightpost.array_types import Array
from eightpost.ident.shock.closed import dynamics_for
from eightpost.ident.shock.curve import CurveKind
from eightpost.ident.shock.fitted_law import FittedLaw
from eightpost.ident.shock.force import Models, limits_for
from eightpost.ident.shock.gas import gas_columns
from eightpost.ident.shock.joint import Joint, Sketch
from eightpost.ident.shock.options import Choices
from eightpost.ident.shock.problem import Solution
from eightpost.ident.shock.robust import nearly_equal, weights_for
from eightpost.ident.shock.runs import Runs
from eightpost.shock import LAWS

#: Maximum number of reweightings.
_WEIGHINGS = 4


def models_for(runs: Runs, law: str, choices: Choices, curve: CurveKind = "polynomial") -> tuple[Models, list[str]]:
    """Return the force models of a law over runs, and a note on each choice that differs from the dissertation's."""
    gas, gas_notes = gas_columns(runs, choices.gas)
    dynamics = dynamics_for(LAWS[law], limits_for(runs.measured, runs.rate, ceiling=choices.ceiling))
    models = Models(runs, gas, dynamics, curve)
    return models, [*dynamics.changes(), *models.changes, *gas_notes]


@dataclass(frozen=True, slots=True, eq=False)
class LawFit(FittedLaw):
    """A law fitted to runs by the joint recipe.

    Attributes:
        joint: Recipe of the fit.
        sketch: Minimum on the whole record.
    """

    joint: Joint
    sketch: Sketch

    @property
    def runs(self) -> Runs:
        """The runs with the weights of the fit."""
        return self.sketch.models.runs

    @property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        return self.sketch.error

    @property
    def parameter_count(self) -> int:
        """Number of fitted parameters: curve, gas force and the law's own."""
        return int(self.sketch.minimum.parameters.size)

    @property
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.sketch.minimum.converged

    def solution(self) -> Solution:
        """Return the solution with its covariance."""
        return self.joint.solution(self.sketch)

    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum."""
        return self.joint.refitted_rows(self.sketch, weights)


def fit_law(runs: Runs, law: str, choices: Choices, curve: CurveKind = "polynomial") -> LawFit:
    """Fit a law with a kind of curve to runs by the joint recipe."""
    models, notes = models_for(runs, law, choices, curve)
    joint = Joint(choices.shape, choices.order)
    return LawFit(law, tuple(notes), joint, _robust_sketch(joint, models, weights_for(choices.robust)))


def _robust_sketch(joint: Joint, models: Models, weigh: Callable[[Array, float], Array] | None) -> Sketch:
    """Return the finished sketch with weights that follow its own residuals; without `weigh` all weights are equal."""
    sketch = joint.sketch(models)
    if weigh is None:
        return joint.finished(sketch)
    sketch = _reweighted(joint, sketch, weigh)
    whole = joint.finished(sketch)
    if not sketch.is_final and (sketch.weights < 1.0).any():
        weights = weigh(whole.error, models.runs.deviation)
        whole = whole if nearly_equal(weights, whole.weights) else joint.reweighted(whole, weights)
    return whole


def _reweighted(joint: Joint, first: Sketch, weigh: Callable[[Array, float], Array]) -> Sketch:
    """Return a sketch with weights that follow its own residuals; the last reweighting is done on the whole record."""
    sketch = first
    for count in range(_WEIGHINGS if first.is_final else _WEIGHINGS - 1):
        weights = weigh(sketch.error, sketch.models.runs.deviation)
        if nearly_equal(weights, sketch.weights):
            break
        if count and (weights == first.weights).all():
            return first  # no outliers after all; further reweighting would alternate between two results
        # The order of the curve may change at the first reweighting only.
        sketch = joint.reweighted(sketch, weights) if count else joint.reordered(sketch, weights)
    return sketch
