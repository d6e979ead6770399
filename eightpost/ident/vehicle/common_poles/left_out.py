"""Model of fewer tests near a common-pole model, found in one step."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleModel, state_space
from eightpost.ident.vehicle.common_poles.points import points_of
from eightpost.ident.vehicle.common_poles.refinement import Refinement, without_integrals

if TYPE_CHECKING:
    from eightpost.ident.response import FrequencyResponse
    from eightpost.vehicle import StateSpace


def refitted(found: CommonPoleModel, response: FrequencyResponse, *, floor: float) -> StateSpace:
    """Return a model of another response, one step of the refinement from a model; its order does not change.

    Args:
        found: Model of the response of all tests.
        response: Response of some of the tests, with the channels of the first one.
        floor: Lower limit of the standard deviation; see `CommonPoleFit`.
    """
    solution = found.refined.solution
    points = points_of(without_integrals(response.band(*found.band)), floor=floor)
    # The inputs of the blocks are scaled by those of the points.
    blocks = replace(solution.blocks, B=solution.blocks.B * points.input_size / found.points.input_size)
    refined = Refinement(max_iterations=1).refine(points, blocks, solution.through)
    return state_space(refined.solution, points, found.inputs, found.fitted, found.model.outputs)
