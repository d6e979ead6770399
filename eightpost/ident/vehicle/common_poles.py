"""Recipe common-poles: one minimal model for all paths, as the dissertation suggests, with friction at the ports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from time import process_time
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eightpost.array_types import Array, Complex
from eightpost.ident.threads import for_each
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit, CommonPoleModel, refitted, state_space
from eightpost.ident.vehicle.estimators import LocalPolynomial, Recipe, estimate_response, input_noise
from eightpost.ident.vehicle.experiment import CoherentBand, Experiment, Ranges, SupportedBand, lifted_tires, ranges_of
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.ident.vehicle.measured_levels import MeasuredLevels
from eightpost.ident.vehicle.port_search import (
    MODELLED,
    FrictionEstimate,
    FrictionSearch,
    SpringSearch,
    nonlinear_spring_sentence,
    port_springs,
)
from eightpost.ident.vehicle.records import Records, gather
from eightpost.ident.vehicle.refinement import Refinement, integrals
from eightpost.ident.vehicle.simulation import fault_in_simulation, with_port_laws
from eightpost.ident.vehicle.stability import closed_loop_stability, safe_slopes
from eightpost.ident.vehicle.trust import NOT_SIMULATED, UNUSABLE, ForceEstimate, OutputTrust, Trust
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.progress import portion
from eightpost.signals import TimeSeries
from eightpost.uncertainty import MeasureUncertainty
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, add_port_damping

# ---- Uncertainty of a common-pole model due to noise, from models of responses with resampled noise -----------------

#: Correlation below which values count as uncorrelated [1].
_UNCORRELATED = 0.1


def sampled_models(found: CommonPoleModel, count: int = 20, *, seed: int = 0) -> tuple[StateSpace, ...]:
    """Return models of the response with resampled noise."""
    generator, length = np.random.default_rng(seed), correlation_length(found.refined.solution.misfit)
    drawn = [_noise(found, generator, length) for _ in range(count)]
    return tuple(for_each(drawn, lambda noise: _sampled(found, noise)))


def response_deviation(models: tuple[StateSpace, ...], frequency_hz: ArrayLike) -> Array:
    """Return the standard deviation of |H| over sampled models (p, m, K) at `frequency_hz` (K,) [Hz]."""
    H = np.stack([model.frequency_response(frequency_hz) for model in models])
    return np.asarray(np.sqrt(np.mean(np.abs(H - H.mean(axis=0)) ** 2, axis=0) * len(models) / (len(models) - 1)))


def spread(models: tuple[StateSpace, ...], measures: Callable[[StateSpace], Array]) -> Array:
    """Return the standard deviation of measures over sampled models, in the shape of the measures.

    Args:
        measures: Function that returns the measures of a model, an array of any shape (...,).

    Returns:
        Standard deviations (...,) in the units of the measures.
    """
    return np.asarray(np.std(np.stack([measures(model) for model in models]), axis=0, ddof=1))


def correlation_length(misfit: Complex) -> int:
    """Return the number of frequencies over which the misfit (p, m, K) is correlated, as bands may overlap."""
    power = float(np.mean(np.abs(misfit) ** 2))
    for lag in range(1, misfit.shape[2]):
        correlation = float(np.mean((misfit[..., lag:] * misfit[..., :-lag].conj()).real)) / max(power, 1e-300)
        if correlation < _UNCORRELATED:
            return lag
    return int(misfit.shape[2])


def _noise(found: CommonPoleModel, generator: np.random.Generator, length: int) -> Complex:
    """Return noise of standard deviation 1 (p, m, K), correlated over `length` neighbouring frequencies."""
    points = found.points
    white = generator.standard_normal((2, *points.H.shape[:2], points.s.size + length - 1)) * np.sqrt(0.5)
    window = np.lib.stride_tricks.sliding_window_view(white[0] + 1j * white[1], length, axis=2)
    return np.asarray(window.sum(axis=3) / np.sqrt(length))


def _sampled(found: CommonPoleModel, noise: Complex) -> StateSpace:
    points, solution = found.points, found.refined.solution
    noisy = replace(points, H=points.H + np.where(points.known, points.deviation, 0.0) * noise)
    refined = Refinement(max_iterations=1).refine(noisy, solution.blocks, solution.through)
    return state_space(refined.solution, noisy, found.inputs, found.fitted, found.model.outputs)


# ---- Uncertainty due to noise of each output of a common-pole model -------------------------------------------------

#: Linear dampers with which the RMS of an output is evaluated, relative to the baseline damping [1].
DAMPERS = (0.5, 1.0, 2.0)

#: Duration of the first test that is used as the drive [s], and number of frequencies for comparing responses.
_SECONDS, _FREQUENCIES = 60.0, 100


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """Spectra of the inputs that drove a test."""

    names: tuple[str, ...]  #: Names of the r rig inputs.
    frequency: Array  #: Frequencies [Hz] (K,).
    spectra: Complex  #: Spectra of the inputs (r, K).

    @classmethod
    def of(cls, test: TimeSeries, names: Sequence[str], band: tuple[float, float]) -> Excitation:
        """Return the spectra of the first minute of a record in a band [Hz]."""
        rows = np.stack([test[name] for name in names])[:, : round(_SECONDS * test.sample_rate)]
        rows = (rows - rows.mean(axis=1, keepdims=True)) * np.hanning(rows.shape[1])
        frequency = np.fft.rfftfreq(rows.shape[1], 1.0 / test.sample_rate)
        kept = (frequency >= band[0]) & (frequency <= band[1])
        spectra = np.asarray(np.fft.rfft(rows, axis=1)[:, kept], dtype=np.complex128)
        return cls(tuple(names), np.asarray(frequency[kept], dtype=np.float64), spectra)

    def rms(self, model: StateSpace, baseline: Mapping[str, float]) -> Array:
        """Return values proportional to the outputs' RMS with each of `DAMPERS` at all ports (3, p)."""
        rows = []
        for part in DAMPERS:
            closed = add_port_damping(model, {port: (part - 1.0) * rate for port, rate in baseline.items()})
            H = closed.select(inputs=self.names).frequency_response(self.frequency)
            rows.append(np.linalg.norm(np.einsum("prk,rk->pk", H, self.spectra), axis=1))
        return np.array(rows)


def output_trust(
    found: CommonPoleModel,
    tests: Sequence[TimeSeries],
    experiment: Experiment,
    *,
    samples: int,
    with_friction: Mapping[str, float],
) -> dict[str, OutputTrust]:
    """Return the uncertainty of every output.

    The standard deviations due to noise are multiplied by the misfit where it is larger than noise explains.

    Args:
        tests: Records of the tests; the first one drives the setups.
        samples: Number of models with resampled noise that give the standard deviations; at least 2.
        with_friction: Mean square of the part that no linear response explains, with friction relative to without, by
            output.
    """
    models = sampled_models(found, samples)
    response, measure = relative_deviations(found.model, models, tests[0], experiment, found.band)
    trusts = {}
    for k, name in enumerate(found.model.output_names):
        misfit = _misfit(found, name)
        times = max(misfit, 1.0)
        left = with_friction.get(name)
        trusts[name] = OutputTrust(
            float(response[k] * times), float(measure[k] * times), misfit, None if left is None else float(left**0.5)
        )
    return trusts


def relative_deviations(
    model: StateSpace,
    models: tuple[StateSpace, ...],
    test: TimeSeries,
    experiment: Experiment,
    band: tuple[float, float],
) -> tuple[Array, Array]:
    """Return the relative standard deviations over sampled models of each output's responses (p,) and RMS (p,).

    Args:
        band: Lowest and highest frequency of the fit [Hz].
    """
    frequency = np.geomspace(*band, _FREQUENCIES)
    response = _relative(response_deviation(models, frequency), np.abs(model.frequency_response(frequency)))
    drive = Excitation.of(test, experiment.rig, band)
    sizes = drive.rms(model, experiment.baseline_damping)
    scatter = spread(models, lambda one: drive.rms(one, experiment.baseline_damping))
    return response, np.asarray((scatter / np.maximum(sizes, 1e-300)).max(axis=0))


def _misfit(found: CommonPoleModel, name: str) -> float:
    """Return an output's misfit in standard deviations; displacements are not fitted and have that of the velocity."""
    return found.excess[integrals(found.model.output_names).get(name, name)]


def _relative(deviation: Array, size: Array) -> Array:
    """Return the relative standard deviation of each output's responses (p,); all inputs have equal weight."""
    whole = np.maximum(np.mean(size**2, axis=2), 1e-300)
    return np.asarray(np.sqrt(np.mean(np.mean(deviation**2, axis=2) / whole, axis=1)))


# ---- Effects in the car that a model does not have ------------------------------------------------------------------

#: Misfit, in standard deviations of the estimate, above which it is reported as more than noise [1].
EXCESS = 1.5

#: Unexplained part of an output above which it is reported, and coherence above which it is good [1].
_NOISY, _FINE = 0.05, 0.95


def unmodelled(
    response: FrequencyResponse, found: CommonPoleModel, tests: Sequence[TimeSeries], means: Mapping[str, float]
) -> dict[str, str]:
    """Return one sentence for each sign of an effect that is not in the model, by kind of effect.

    Args:
        tests: Records of the tests, without means.
        means: Mean tire forces that the original records had [N], by channel.
    """
    sentences = {
        "misfit": _misfits(found),
        "lift-off": _lifted(tests, means),
        "unexplained": _coherence(response, found),
    }
    return {what: sentence for what, sentence in sentences.items() if sentence}


def _misfits(found: CommonPoleModel) -> str:
    worst: dict[str, float] = {}
    for name, value in found.excess.items():
        quantity = name.rpartition(".")[2]
        worst[quantity] = max(value, worst.get(quantity, 0.0))
    listed = ", ".join(f"{quantity} {value:.1f}" for quantity, value in worst.items() if value > EXCESS)
    if not listed:
        return ""
    return (
        f"The misfit is larger than noise (in standard deviations, worst of each: {listed}). Likely causes are "
        "nonlinear effects, above all stick-slip, or too few states. The reported standard deviations are increased "
        "accordingly."
    )


def _lifted(tests: Sequence[TimeSeries], means: Mapping[str, float]) -> str:
    names = sorted(lifted_tires(tests, means))
    if not names:
        return ""
    return (
        f"Tires leave the ground ({', '.join(names)}), which the linear model cannot represent; lower the road's peak."
    )


def _coherence(response: FrequencyResponse, found: CommonPoleModel) -> str:
    """Return a sentence on outputs that are noisy although their coherence is good: a sign of friction or springs."""
    if response.coherence is None:
        return ""
    low, high = found.band
    inside = (response.frequency >= low) & (response.frequency <= high)
    left = np.sqrt(1.0 - np.median(response.coherence[:, inside], axis=1))
    names = [
        f"{name} {100.0 * share:.0f} %"
        for name, share in zip(response.output_names, left, strict=True)
        if _NOISY < share < np.sqrt(1.0 - _FINE**2)
    ]
    if not names:
        return ""
    return (
        f"Not explained by any linear response although coherence is good: {', '.join(names)} of the output. If the "
        "sensors are less noisy than that, the cause is friction or nonlinear springs."
    )


# ==== The recipe ======================================================================================================

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
