"""Recipe common-poles: one minimal model for all paths, as the dissertation suggests, with friction at the ports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from time import process_time
from typing import NamedTuple

from eightpost.ident.response import FrequencyResponse, LocalPolynomial, Recipe, estimate_response, gather
from eightpost.ident.response.input_noise import input_noise
from eightpost.ident.response.records import Records
from eightpost.ident.vehicle.band import CoherentBand, SupportedBand
from eightpost.ident.vehicle.common_poles import (
    CommonPoleFit,
    CommonPoleModel,
    output_trust,
    refitted,
    unmodelled,
)
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.free_running import fault_in_simulation
from eightpost.ident.vehicle.friction_search import FrictionEstimate, FrictionSearch
from eightpost.ident.vehicle.measured_levels import MeasuredLevels
from eightpost.ident.vehicle.port_laws import with_port_laws
from eightpost.ident.vehicle.ranges import Ranges, ranges_of
from eightpost.ident.vehicle.springs import MODELLED, SpringSearch, nonlinear_spring_sentence, port_springs
from eightpost.ident.vehicle.stability import closed_loop_stability, safe_slopes
from eightpost.ident.vehicle.trust import NOT_SIMULATED, UNUSABLE, ForceEstimate, OutputTrust, Trust
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.measure_uncertainty import MeasureUncertainty
from eightpost.progress import portion
from eightpost.signals import TimeSeries
from eightpost.vehicle import Friction, IdentifiedVehicle

#: Shares of the band that are tried one after the other, if a model cannot be used [1].
_SHARES = (1.0, 0.65)

#: Flag of a vehicle that fails in its own simulation, as all simpler ones did.
_NONE_USABLE = "No model could be used; the first one was kept."


@dataclass(frozen=True, slots=True)
class CommonPoles:
    """Recipe that estimates the laws of the ports, the response around them, and a common-pole model of that response.

    The laws are friction that sticks or creeps, whichever explains more, and springs that are not linear. The vehicle
    has exactly the laws that the response was estimated with. If it is unstable or fails in a simulation, simpler laws
    are tried.
    """

    #: Method of estimating the response.
    estimate: Recipe = field(default_factory=lambda: LocalPolynomial(half_width=0.05, spacing=0.1, high=32.0))
    #: Settings of the model fit. The upper end of its band is replaced by that of `band`.
    fit: CommonPoleFit = field(default_factory=CommonPoleFit)
    #: Criterion for the upper end of the band; None uses that of `fit`.
    band: CoherentBand | None = field(default_factory=CoherentBand)
    #: Settings of the friction estimate; None assumes ports without friction.
    friction: FrictionSearch | None = field(default_factory=FrictionSearch)
    #: Settings of the estimate of nonlinear springs; None assumes linear springs.
    springs: SpringSearch | None = field(default_factory=SpringSearch)
    samples: int = 8  #: Number of models with resampled noise that give the standard deviations; 0 gives none.
    #: Settings of the uncertainty of measures on other drives; None gives none.
    levels: MeasuredLevels | None = field(default_factory=MeasuredLevels)

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
        with portion(0.0, 0.78):
            car, failed, usable = self._usable_car(tests, experiment)
        with portion(0.78, 1.0):
            return self._identification(car, tests, experiment, (started, failed, usable))

    def vehicle(self, tests: Sequence[TimeSeries], experiment: Experiment) -> IdentifiedVehicle:
        """Return the vehicle without its uncertainty, which takes less time.

        Raises:
            InputError: Tests and experiment do not match, or the effects of the inputs cannot be separated.
            TooShortError: The records have too few frequency bins.
        """
        return self._usable_car(tests, experiment)[0].vehicle

    def _usable_car(self, tests: Sequence[TimeSeries], experiment: Experiment) -> tuple[_Car, tuple[str, ...], bool]:
        """Return the first car that can be simulated, or else the first one.

        Also return notes on those that were rejected, and whether the car can be simulated.
        """
        failed: list[str] = []
        first: _Car | None = None
        for laws, share in product(self._port_laws(tests, experiment), _SHARES):
            car = self._car(tests, experiment, laws, share)
            fault = fault_in_simulation(car.vehicle, tests)
            if fault is None:
                return car, tuple(failed), True
            failed.append(f"A model with {laws.text} up to {car.found.band[1]:.3g} Hz was rejected: {fault}.")
            first = first or car
        assert first is not None
        return first, tuple(failed), False

    def _port_laws(self, tests: Sequence[TimeSeries], experiment: Experiment) -> Iterator[_PortLaws]:
        """Yield the laws of the ports, the best first, then simpler ones."""
        searches = [self.friction] if self.friction is not None else []
        for search in searches:
            with portion(0.0, 0.13):
                friction = search.find(tests, experiment)
            laws = _PortLaws.of(friction)
            springs = {} if self.springs is None else self.springs.find(laws.added_to(tests), experiment)
            stiff = port_springs(springs, tests, experiment.ports)
            if stiff:
                yield laws.with_springs(springs, stiff)
            yield replace(laws, springs=springs)
            if friction.sticks:
                searches.append(search.creeping)
        plain = _PortLaws.of(None)
        springs = {} if self.springs is None or self.friction is not None else self.springs.find(tests, experiment)
        yield replace(plain, springs=springs)

    def _car(self, tests: Sequence[TimeSeries], experiment: Experiment, laws: _PortLaws, share: float = 1.0) -> _Car:
        """Return the car for the laws of the ports, fitted in the lower `share` of the band."""
        with portion(0.13, 0.38):
            response = self._response(laws.added_to(tests), experiment)
        supported = None if self.band is None else self.band.of(response)
        fit = replace(self.fit, high=share * (self.fit.high if supported is None else supported.high))
        with portion(0.38, 1.0):
            found = fit.fit(response)
        vehicle = IdentifiedVehicle(
            experiment.name,
            found.model,
            experiment.baseline_damping,
            experiment.static,
            experiment.sources,
            laws.of_ports,
        )
        return _Car(vehicle, found, response, laws, supported)

    def _identification(
        self,
        car: _Car,
        tests: Sequence[TimeSeries],
        experiment: Experiment,
        before: tuple[float, tuple[str, ...], bool],
    ) -> Identification:
        """Return the result for a car.

        `before` has the time at the start, notes on the cars that were rejected, and whether the car can be simulated.
        """
        found, laws, friction = car.found, car.laws, car.laws.friction
        started, failed, usable = before
        with portion(0.0, 0.5):
            outputs = self._outputs(found, tests, experiment, friction)
        with portion(0.5, 1.0):
            measures = self._measures(car, tests, experiment)
        ranges = ranges_of(tests, experiment, found.band)
        stability = closed_loop_stability(car.vehicle)
        flags = laws.flags | unmodelled(car.response, found, tests, experiment.means)
        if not usable:
            flags[UNUSABLE] = _NONE_USABLE
        elif self.levels is not None and not measures:
            flags[UNUSABLE] = NOT_SIMULATED
        unused = friction is not None and not friction.acts
        notes = (
            f"{len(found.model.A)} states from {found.band[0]:g} to {found.band[1]:g} Hz",
            *(() if car.supported is None else (car.supported.summary(),)),
            *failed,
            input_noise(_gathered(laws.added_to(tests), experiment), found.band).summary(self.estimate),
            *found.notes,
            *(("No significant friction was found at the ports.",) if unused else ()),
            *flags.values(),
            *((self.levels.note(tests, experiment, measures),) if self.levels is not None and measures else ()),
            stability.summary(),
            safe_slopes(found.model, experiment.baseline_damping).summary(),
        )
        trust = Trust(
            outputs,
            {} if friction is None else friction.forces,
            laws.springs,
            flags,
            found.orders,
            self.samples,
            measures,
        )
        fit = VehicleFit(
            car.vehicle, "common-poles", car.response, found.residual, notes, process_time() - started,
            stability.stable, ranges.as_mapping(), trust,
        )  # fmt: skip
        return Identification(fit, found, car.response, friction, ranges)

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
        self, car: _Car, tests: Sequence[TimeSeries], experiment: Experiment
    ) -> dict[str, MeasureUncertainty]:
        """Return the uncertainty of measures on other drives."""
        if self.levels is None:
            return {}
        found, corrected = car.found, car.laws.added_to(tests)

        def refit(kept: Sequence[int]) -> IdentifiedVehicle:
            response = self._response([corrected[k] for k in kept], experiment)
            return replace(car.vehicle, state_space=refitted(found, response, floor=self.fit.floor))

        return self.levels.uncertainty(car.vehicle, tests, experiment, refit=refit)

    def _response(self, tests: Sequence[TimeSeries], experiment: Experiment) -> FrequencyResponse:
        return estimate_response(
            tests,
            inputs=experiment.inputs,
            outputs=experiment.outputs,
            recipe=self.estimate,
            baseline_damping=experiment.baseline_damping,
        )


def _gathered(tests: Sequence[TimeSeries], experiment: Experiment) -> Records:
    return gather(tests, experiment.inputs, experiment.outputs, experiment.baseline_damping)


@dataclass(frozen=True, slots=True, eq=False)
class _PortLaws:
    """Laws of the ports that a response is estimated around."""

    friction: FrictionEstimate | None  #: Estimate of the friction; None if it was not estimated.
    springs: Mapping[str, ForceEstimate]  #: Estimate of the nonlinear springs.
    of_ports: Mapping[str, Friction]  #: Friction and springs of the vehicle, by port.

    @classmethod
    def of(cls, friction: FrictionEstimate | None) -> _PortLaws:
        """Return laws without springs."""
        found = {} if friction is None else friction.friction
        return cls(friction, {}, {port: law for port, law in found.items() if law.acts})

    def with_springs(self, springs: Mapping[str, ForceEstimate], stiff: Mapping[str, float]) -> _PortLaws:
        """Return the laws with the coefficients `stiff` [N/m2] of the springs' estimate."""
        laws = dict(self.of_ports)
        for port, coefficient in stiff.items():
            laws[port] = laws.get(port, Friction())._replace(spring=coefficient)
        return _PortLaws(self.friction, springs, laws)

    def added_to(self, tests: Sequence[TimeSeries]) -> list[TimeSeries]:
        """Return the tests with the laws' forces included in the shock forces."""
        return [with_port_laws(test, self.of_ports) for test in tests]

    @property
    def flags(self) -> dict[str, str]:
        """Sentences on the friction, and on springs that are not linear."""
        flags = {"friction": self.friction.summary()} if self.friction is not None and self.friction.acts else {}
        if any(law.spring for law in self.of_ports.values()):
            sentence, key = nonlinear_spring_sentence(self.springs, held=MODELLED), "port springs"
        else:
            sentence, key = nonlinear_spring_sentence(self.springs), "springs"
        return flags if sentence is None else flags | {key: sentence}

    @property
    def text(self) -> str:
        """Names of the laws."""
        laws = list(self.of_ports.values())
        names = [name for name, is_there in (
            ("friction that sticks", any(law.bristle.force for law in laws)),
            ("friction that creeps", any(law.force for law in laws)),
            ("port springs", any(law.spring for law in laws)),
        ) if is_there]  # fmt: skip
        return " and ".join(names) or "linear ports"


class _Car(NamedTuple):
    """A vehicle with its fit, the response that was fitted, the laws of its ports, and the band that was found."""

    vehicle: IdentifiedVehicle
    found: CommonPoleModel
    response: FrequencyResponse
    laws: _PortLaws
    supported: SupportedBand | None


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """A fit with its intermediate results."""

    vehicle_fit: VehicleFit  #: Fit that `identify` returns.
    model_fit: CommonPoleModel  #: Common-pole model with details of its fit.
    response: FrequencyResponse  #: Response that was fitted, around baseline damping and friction.
    friction: FrictionEstimate | None  #: Estimated friction at the ports; None if it was not estimated.
    ranges: Ranges  #: Ranges that the tests covered.


RECIPE = CommonPoles()
