"""Recipe common-poles: one minimal model for all paths, as the dissertation suggests, with friction at the ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import process_time

from eightpost.ident.response import FrequencyResponse, LocalPolynomial, Recipe, estimate_response
from eightpost.ident.vehicle.common_poles import (
    CommonPoleFit,
    CommonPoleModel,
    output_trust,
    refitted,
    unmodelled,
)
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.friction import FrictionEstimate, FrictionSearch, with_friction
from eightpost.ident.vehicle.measure_uncertainty import MeasureUncertainty
from eightpost.ident.vehicle.model_form import ModelForm
from eightpost.ident.vehicle.ranges import Ranges, ranges_of
from eightpost.ident.vehicle.springs import SpringSearch, nonlinear_spring_sentence
from eightpost.ident.vehicle.stability import closed_loop_stability, safe_slopes
from eightpost.ident.vehicle.trust import ForceEstimate, OutputTrust, Trust
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle

#: Note on a vehicle that cannot be simulated with the shocks of its own tests.
_NOT_SIMULATED = (
    "A test could not be simulated with its own shocks in the loop, so the accuracy of predicted measures is not known."
)


@dataclass(frozen=True, slots=True)
class CommonPoles:
    """Recipe that estimates friction at the ports, the local polynomial response around it, and a common-pole model.

    Attributes:
        estimate: Method of estimating the response.
        fit: Settings of the model fit.
        friction: Settings of the friction estimate; None assumes ports without friction.
        springs: Settings of the test for nonlinear springs, which are reported and not modelled; None skips the test.
        samples: Number of models with resampled noise that give the standard deviations; 0 gives none.
        model_form: Settings of the uncertainty of measures on other drives; None gives none. It needs `samples`.
    """

    estimate: Recipe = field(default_factory=lambda: LocalPolynomial(high=20.0))
    fit: CommonPoleFit = field(default_factory=CommonPoleFit)
    friction: FrictionSearch | None = field(default_factory=FrictionSearch)
    springs: SpringSearch | None = field(default_factory=SpringSearch)
    samples: int = 8
    model_form: ModelForm | None = field(default_factory=ModelForm)

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle; see `VehicleRecipe`."""
        return self.explain(tests, experiment).vehicle_fit

    def explain(self, tests: Sequence[TimeSeries], experiment: Experiment) -> Identification:
        """Identify a vehicle and return all intermediate results.

        Raises:
            InputError: Tests and experiment do not match, or the effects of the inputs cannot be separated.
            TooShortError: The records have too few frequency bins.
        """
        started = process_time()
        friction = None if self.friction is None else self.friction.find(tests, experiment)
        laws = {} if friction is None else {port: law for port, law in friction.friction.items() if law.force > 0.0}
        corrected = [with_friction(test, laws) for test in tests]
        response = self._response(corrected, experiment)
        found = self.fit.fit(response)
        vehicle = IdentifiedVehicle(
            experiment.name,
            found.model,
            experiment.baseline_damping,
            experiment.static,
            experiment.sources,
            laws,
        )
        outputs = self._outputs(found, tests, experiment, friction)
        measures = self._measures(vehicle, found, tests, corrected, experiment, outputs)
        ranges = ranges_of(tests, experiment, found.band)
        stability = closed_loop_stability(vehicle)
        springs = {} if self.springs is None else self.springs.find(corrected, experiment)
        flags = _flags(friction, springs) | unmodelled(response, found, tests, experiment.means)
        notes = (
            f"{len(found.model.A)} states from {found.band[0]:g} to {found.band[1]:g} Hz",
            *found.notes,
            *(
                ("No significant friction was found at the ports.",)
                if friction is not None and not friction.acts
                else ()
            ),
            *flags.values(),
            *((_NOT_SIMULATED,) if outputs and self.model_form is not None and not measures else ()),
            stability.summary(),
            safe_slopes(found.model, experiment.baseline_damping).summary(),
        )
        fit = VehicleFit(
            vehicle,
            "common-poles",
            response,
            found.residual,
            notes,
            process_time() - started,
            stability.stable,
            ranges.as_mapping(),
            Trust(
                outputs,
                {} if friction is None else friction.forces,
                springs,
                flags,
                found.orders,
                self.samples,
                measures,
            ),
        )
        return Identification(fit, found, response, friction, ranges)

    def _outputs(
        self,
        found: CommonPoleModel,
        tests: Sequence[TimeSeries],
        experiment: Experiment,
        friction: FrictionEstimate | None,
    ) -> dict[str, OutputTrust]:
        if self.samples < 2:
            return {}
        left = {} if friction is None else friction.residual
        return output_trust(found, tests, experiment, samples=self.samples, with_friction=left)

    def _measures(
        self,
        vehicle: IdentifiedVehicle,
        found: CommonPoleModel,
        tests: Sequence[TimeSeries],
        corrected: Sequence[TimeSeries],
        experiment: Experiment,
        outputs: Mapping[str, OutputTrust],
    ) -> dict[str, MeasureUncertainty]:
        """Return the uncertainty of measures on other drives; `corrected` are the tests with friction."""
        if self.model_form is None or not outputs:
            return {}

        def refit(kept: Sequence[int]) -> IdentifiedVehicle:
            response = self._response([corrected[k] for k in kept], experiment)
            return replace(vehicle, state_space=refitted(found, response, floor=self.fit.floor))

        return self.model_form.uncertainty(vehicle, tests, experiment, found.band, refit=refit, outputs=outputs)

    def _response(self, tests: Sequence[TimeSeries], experiment: Experiment) -> FrequencyResponse:
        return estimate_response(
            tests,
            inputs=experiment.inputs,
            outputs=experiment.outputs,
            recipe=self.estimate,
            baseline_damping=experiment.baseline_damping,
        )


def _flags(friction: FrictionEstimate | None, springs: Mapping[str, ForceEstimate]) -> dict[str, str]:
    flags = {"friction": friction.summary()} if friction is not None and friction.acts else {}
    sentence = nonlinear_spring_sentence(springs)
    return flags if sentence is None else flags | {"springs": sentence}


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """A fit with its intermediate results.

    Attributes:
        vehicle_fit: Fit that `identify` returns.
        model_fit: Common-pole model with details of its fit.
        response: Response that was fitted, around baseline damping and friction.
        friction: Estimated friction at the ports; None if it was not estimated.
        ranges: Ranges that the tests covered.
    """

    vehicle_fit: VehicleFit
    model_fit: CommonPoleModel
    response: FrequencyResponse
    friction: FrictionEstimate | None
    ranges: Ranges


RECIPE = CommonPoles()
