"""The way that the dissertation's last chapter asks for: one minimal model for all paths, friction at the ports."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import process_time
from typing import TYPE_CHECKING

from eightpost.ident.response import FrequencyResponse, LocalPolynomial, Recipe, estimate_response
from eightpost.ident.vehicle.common_poles import (
    CommonPoleFit,
    CommonPoleModel,
    Ranges,
    ranges_of,
    swapping,
    unmodelled,
)
from eightpost.ident.vehicle.friction import FrictionEstimate, FrictionSearch, with_friction
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.vehicle import IdentifiedVehicle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class CommonPoles:
    """Friction from the residual, local polynomial response around it, one common-pole model.

    Attributes:
        estimate: How the response is estimated.
        fit: How the model is found.
        friction: How friction is looked for; None takes the ports without any.
    """

    estimate: Recipe = field(default_factory=lambda: LocalPolynomial(high=20.0))
    fit: CommonPoleFit = field(default_factory=CommonPoleFit)
    friction: FrictionSearch | None = field(default_factory=FrictionSearch)

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle; see `VehicleRecipe`."""
        return self.explain(tests, experiment).vehicle_fit

    def explain(self, tests: Sequence[TimeSeries], experiment: Experiment) -> Identification:
        """Identify a vehicle and return all that was found on the way.

        Raises:
            InputError: Tests and experiment do not fit together, or do not tell the inputs apart.
            TooShortError: The records have too few bins.
        """
        started = process_time()
        rubbing = None if self.friction is None else self.friction.find(tests, experiment)
        laws = {} if rubbing is None else {port: law for port, law in rubbing.friction.items() if law.force > 0.0}
        response = estimate_response(
            [with_friction(test, laws) for test in tests],
            inputs=experiment.inputs,
            outputs=experiment.outputs,
            recipe=self.estimate,
            baseline_damping=experiment.baseline_damping,
        )
        found = self.fit.fit(response)
        vehicle = IdentifiedVehicle(
            experiment.name,
            found.model,
            experiment.baseline_damping,
            experiment.static,
            experiment.sources,
            laws,
        )
        ranges = ranges_of(tests, experiment, found.band)
        settles = closed_loop_stability(vehicle)
        notes = (
            f"{len(found.model.A)} states from {found.band[0]:g} to {found.band[1]:g} Hz",
            *found.notes,
            *(() if rubbing is None else (rubbing.said(),)),
            *unmodelled(response, found, tests),
            settles.said(),
            swapping(found.model, experiment.baseline_damping).said(),
        )
        fit = VehicleFit(
            vehicle,
            "common-poles",
            response,
            found.residual,
            notes,
            process_time() - started,
            settles.stable,
            ranges.as_mapping(),
        )
        return Identification(fit, found, response, rubbing, ranges)


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """A fit with all that was found on the way.

    Attributes:
        vehicle_fit: What `identify` returns.
        found: The model with the search for it.
        response: What was fitted, around baseline damping and friction.
        friction: What was found at the ports; None where it was not looked for.
        ranges: What the tests covered.
    """

    vehicle_fit: VehicleFit
    found: CommonPoleModel
    response: FrequencyResponse
    friction: FrictionEstimate | None
    ranges: Ranges


RECIPE = CommonPoles()
