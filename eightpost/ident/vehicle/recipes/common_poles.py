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
    orders_of,
    output_trust,
    ranges_of,
    swapping,
    unmodelled,
)
from eightpost.ident.vehicle.friction import FrictionEstimate, FrictionSearch, with_friction
from eightpost.ident.vehicle.springs import SpringSearch, bent
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.ident.vehicle.trust import Trust
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.vehicle import IdentifiedVehicle

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.ident.vehicle.trust import FoundForce, OutputTrust
    from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class CommonPoles:
    """Friction from the residual, local polynomial response around it, one common-pole model.

    Attributes:
        estimate: How the response is estimated.
        fit: How the model is found.
        friction: How friction is looked for; None takes the ports without any.
        springs: How bent springs are looked for; None does not. They are said and not modelled.
        samples: From how many models with other noise deviations are told; 0 tells none.
    """

    estimate: Recipe = field(default_factory=lambda: LocalPolynomial(high=20.0))
    fit: CommonPoleFit = field(default_factory=CommonPoleFit)
    friction: FrictionSearch | None = field(default_factory=FrictionSearch)
    springs: SpringSearch | None = field(default_factory=SpringSearch)
    samples: int = 8

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
        rubbed = [with_friction(test, laws) for test in tests]
        response = estimate_response(
            rubbed,
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
        springs = {} if self.springs is None else self.springs.find(rubbed, experiment)
        flags = _flags(rubbing, springs) | unmodelled(response, found, tests, experiment.means)
        notes = (
            f"{len(found.model.A)} states from {found.band[0]:g} to {found.band[1]:g} Hz",
            *found.notes,
            *(("No friction at the ports is told from noise.",) if rubbing is not None and not rubbing.acts else ()),
            *flags.values(),
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
            Trust(
                self._outputs(found, tests, experiment, rubbing),
                {} if rubbing is None else rubbing.found,
                springs,
                flags,
                orders_of(found),
                self.samples,
            ),
        )
        return Identification(fit, found, response, rubbing, ranges)

    def _outputs(
        self,
        found: CommonPoleModel,
        tests: Sequence[TimeSeries],
        experiment: Experiment,
        rubbing: FrictionEstimate | None,
    ) -> dict[str, OutputTrust]:
        if self.samples < 2:
            return {}
        left = {} if rubbing is None else rubbing.residual
        return output_trust(found, tests, experiment, samples=self.samples, with_friction=left)


def _flags(rubbing: FrictionEstimate | None, springs: Mapping[str, FoundForce]) -> dict[str, str]:
    flags = {"friction": rubbing.said()} if rubbing is not None and rubbing.acts else {}
    crooked = bent(springs)
    return flags if crooked is None else flags | {"springs": crooked}


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
