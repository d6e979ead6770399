"""A response to one minimal linear model: every path shares the poles (section 6.6 asks for it)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.common_poles.feedthrough import Feedthrough
from eightpost.ident.vehicle.common_poles.order import OrderStudy, description_length, start, study_orders
from eightpost.ident.vehicle.common_poles.physics import (
    direct_terms,
    integrals,
    roads,
    with_integrals,
    without_integrals,
)
from eightpost.ident.vehicle.common_poles.points import Points, points_of
from eightpost.ident.vehicle.common_poles.refinement import Refined, Refinement, Solution
from eightpost.ident.vehicle.common_poles.rest import brought_to_rest
from eightpost.ident.vehicle.common_poles.subspace import subspace_of
from eightpost.vehicle.statespace import StateSpace

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.ident.response import FrequencyResponse
    from eightpost.ident.vehicle.common_poles.realisation import Blocks
    from eightpost.vehicle.statespace import Channel

    Array = NDArray[np.float64]
    Channels = tuple[Channel, ...]

#: A misfit of fewer deviations is noise [1].
_EXPLAINED = 1.1

#: Lags of the roads are this many times faster than the band.
_FAST = 20.0

#: Frequencies at which models of rising order are compared.
_STUDIED = 100


@dataclass(frozen=True, slots=True)
class CommonPoleFit:
    """How a common-pole model is found: subspace for the start, maximum likelihood from there.

    Attributes:
        order: Number of states, even, lags of the roads not counted; None takes the suggested one.
        low: Lowest frequency of the fit [Hz].
        high: Highest [Hz]. Beyond, a rig's drive fades and the forces' noise biases the estimate.
        floor: Deviation of a response value at least, of its output's size [1].
        most_states: Highest order that is suggested.
        lags: Whether roads may act through fast lags, as damped tires make them.
        refinement: How the likelihood is maximised.
    """

    order: int | None = None
    low: float = 0.1
    high: float = 16.0
    floor: float = 2e-3
    most_states: int = 28
    lags: bool = True
    refinement: Refinement = field(default_factory=Refinement)

    def __post_init__(self) -> None:
        """Check the settings."""
        if self.order is not None and (self.order < 2 or self.order % 2):
            raise ParameterError(f"the order is {self.order}; a model is made of pairs of poles: give 2, 4, 6 ...")
        if not (0.0 <= self.low < self.high and self.floor > 0.0 and self.most_states >= 2):
            raise ParameterError(f"{self}: low from 0 and below high, floor above 0, most_states from 2")

    def fit(self, response: FrequencyResponse) -> CommonPoleModel:
        """Fit a response around a baseline damping.

        Raises:
            InputError: A channel has no value in the band.
            TooShortError: Fewer values than the states need.
        """
        joined = without_integrals(response.band(self.low, self.high))
        points = points_of(joined, floor=self.floor)
        direct = direct_terms(joined.output_names, joined.input_names)
        plain = Feedthrough.of(direct, _FAST * 2.0 * np.pi * self.high)
        subspace = subspace_of(points, most_states=max(self.most_states, self.order or 0))
        study = study_orders(points.thinned(_STUDIED), subspace, plain, self._orders())
        found, mirrored = start(points, subspace, self.order or study.suggested, plain)
        refined = self._refined(points, found.blocks, plain, roads(joined.input_names))
        return _model(response, joined, points, refined, Start(study, mirrored, found.cost))

    def _refined(self, points: Points, blocks: Blocks, plain: Feedthrough, lagged: NDArray[np.bool_]) -> Refined:
        """Return the best model without lags where that explains the response, else with lags on the roads."""
        refined = self.refinement.refine(points, blocks, plain)
        excess = np.sqrt(refined.solution.cost / points.known.sum())
        if not self.lags or excess < _EXPLAINED or not lagged.any():
            return refined
        other = self.refinement.refine(points, refined.solution.blocks, plain.with_lags(lagged))
        return min(refined, other, key=lambda tried: description_length(tried.solution, points))

    def _orders(self) -> tuple[int, ...]:
        return tuple(range(2, self.most_states + 1, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """What the subspace gave.

    Attributes:
        study: Models of rising order.
        mirrored: How many poles of the chosen one were unstable, and mirrored.
        cost: Sum of squares of its weighted misfit.
    """

    study: OrderStudy
    mirrored: int
    cost: float


@dataclass(frozen=True, slots=True, eq=False)
class CommonPoleModel:
    """A common-pole model and how it was found.

    Attributes:
        model: Minimal and continuous, stable, on the response's channels.
        residual: By output, RMS of the misfit over that of the response, weighted as in the fit [1].
        excess: By output, RMS of the misfit in deviations of the estimate; 1 where noise explains all.
        refined: The model in the fit's own scaled channels.
        points: What was fitted.
        inputs: The inputs of `points`.
        fitted: The outputs of `points`.
        start: What the subspace gave.
        band: Lowest and highest frequency that were fitted [Hz].
    """

    model: StateSpace
    residual: Mapping[str, float]
    excess: Mapping[str, float]
    refined: Refined
    points: Points
    inputs: Channels
    fitted: Channels
    start: Start
    band: tuple[float, float]

    @property
    def order(self) -> int:
        """The number of states, lags of the roads not counted."""
        return self.refined.solution.blocks.states

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person must know of the search, a sentence each."""
        study, notes = self.start.study, []
        if not study.clear and self.order == study.suggested:
            notes.append(
                f"The singular values have no clear gap; {self.order} states have the least description length."
            )
        if self.order != study.suggested:
            notes.append(f"{self.order} states were asked for; {study.suggested} are suggested.")
        if self.start.mirrored:
            notes.append(f"{self.start.mirrored} poles of the start were unstable and mirrored before the refinement.")
        lags = self.refined.solution.through.states
        if lags:
            notes.append(f"The roads act through {lags} fast lags besides, as on damped tires.")
        if not self.refined.converged:
            notes.append(f"The refinement had not settled after {self.refined.iterations} steps; the best is kept.")
        return tuple(notes)


def state_space(
    solution: Solution, points: Points, inputs: Channels, fitted: Channels, outputs: Channels
) -> StateSpace:
    """Return a solution in the response's own units, with all `outputs`."""
    u, y, rate = points.input_size, points.output_size, solution.through.rate
    lagged = solution.through.lagged
    slow = np.full(int(lagged.sum()), -rate)
    model = StateSpace(
        block_diag(solution.blocks.A, np.diag(slow)),
        np.vstack((solution.blocks.input_matrix, rate * np.eye(lagged.size)[lagged])) / u,
        np.hstack((solution.C, solution.lagged[:, lagged])) * y[:, None],
        solution.D * y[:, None] / u,
        inputs,
        fitted,
        None,
        "common_poles",
    )
    weight = points.weight.mean(axis=1) / y[:, None]
    return with_integrals(brought_to_rest(model, solution.blocks.states, points.s, weight), outputs)


def _model(
    response: FrequencyResponse, joined: FrequencyResponse, points: Points, refined: Refined, begun: Start
) -> CommonPoleModel:
    misfit, whole = np.abs(refined.solution.misfit) ** 2, np.abs(points.weight * points.H) ** 2
    known = np.maximum(points.known.sum(axis=(1, 2)), 1)
    residual = np.sqrt(misfit.sum(axis=(1, 2)) / np.maximum(whole.sum(axis=(1, 2)), 1e-300))
    excess = np.sqrt(misfit.sum(axis=(1, 2)) / known)
    names = joined.output_names
    return CommonPoleModel(
        state_space(refined.solution, points, joined.inputs, joined.outputs, response.outputs),
        _with_integrals(dict(zip(names, residual.tolist(), strict=True)), response),
        dict(zip(names, excess.tolist(), strict=True)),
        refined,
        points,
        joined.inputs,
        joined.outputs,
        begun,
        (float(joined.frequency[1]), float(joined.frequency[-1])),
    )


def _with_integrals(residual: dict[str, float], response: FrequencyResponse) -> dict[str, float]:
    """Return the residuals in the response's order; a displacement, no output of the fit, has its velocity's."""
    pairs = integrals(response.output_names)
    return {name: residual[pairs.get(name, name)] for name in response.output_names}
