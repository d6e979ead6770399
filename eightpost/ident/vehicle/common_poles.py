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
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit, CommonPoleModel, integrals, refitted, state_space
from eightpost.ident.vehicle.estimators import LocalPolynomial, Recipe, estimate_response, input_noise
from eightpost.ident.vehicle.experiment import CoherentBand, Experiment, SupportedBand, gather, lifted_tires, ranges_of
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.ident.vehicle.pole_search import Refinement
from eightpost.ident.vehicle.port_search import (
    MODELLED,
    FrictionEstimate,
    FrictionSearch,
    SpringSearch,
    nonlinear_spring_sentence,
    port_springs,
)
from eightpost.ident.vehicle.simulation import fault_in_simulation, with_port_laws
from eightpost.ident.vehicle.stability import closed_loop_stability, safe_slopes
from eightpost.ident.vehicle.trust import NOT_SIMULATED, UNUSABLE, ForceEstimate, MeasuredLevels, OutputTrust, Trust
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.progress import portion
from eightpost.signals import TimeSeries
from eightpost.uncertainty import MeasureUncertainty
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, add_port_damping

# ==== Uncertainty of a common-pole model due to noise, from models of responses with resampled noise =================

#: Correlation below which values count as uncorrelated [1].
_UNCORRELATED = 0.1

#: Linear dampers with which the RMS of an output is evaluated, relative to the baseline damping [1].
DAMPERS = (0.5, 1.0, 2.0)

#: Duration of the first test that is used as the drive [s], and number of frequencies for comparing responses.
_SECONDS, _FREQUENCIES = 60.0, 100


def sampled_models(found: CommonPoleModel, count: int = 20, *, seed: int = 0) -> tuple[StateSpace, ...]:
    """Return models of the response with resampled noise."""
    points, solution = found.points, found.refined.solution
    generator, length = np.random.default_rng(seed), correlation_length(solution.misfit)
    size = np.where(points.known, points.deviation, 0.0)

    def model(drawn: Complex) -> StateSpace:
        noisy = replace(points, H=points.H + size * drawn)
        refined = Refinement(max_iterations=1).refine(noisy, solution.blocks, solution.through)
        return state_space(refined.solution, noisy, found.inputs, found.fitted, found.model.outputs)

    return tuple(for_each([correlated_noise(generator, points.H.shape, length) for _ in range(count)], model))


def correlated_noise(generator: np.random.Generator, shape: tuple[int, ...], length: int) -> Complex:
    """Return noise of standard deviation 1 (p, m, K), correlated over `length` neighbouring frequencies."""
    white = generator.standard_normal((2, *shape[:2], shape[2] + length - 1)) * np.sqrt(0.5)
    window = np.lib.stride_tricks.sliding_window_view(white[0] + 1j * white[1], length, axis=2)
    return np.asarray(window.sum(axis=3) / np.sqrt(length))


def correlation_length(misfit: Complex) -> int:
    """Return the number of frequencies over which the misfit (p, m, K) is correlated, as bands may overlap."""
    power = float(np.mean(np.abs(misfit) ** 2))
    for lag in range(1, misfit.shape[2]):
        correlation = float(np.mean((misfit[..., lag:] * misfit[..., :-lag].conj()).real)) / max(power, 1e-300)
        if correlation < _UNCORRELATED:
            return lag
    return int(misfit.shape[2])


def response_deviation(models: tuple[StateSpace, ...], frequency_hz: ArrayLike) -> Array:
    """Return the standard deviation of |H| over sampled models (p, m, K) at `frequency_hz` (K,) [Hz]."""
    H = np.stack([model.frequency_response(frequency_hz) for model in models])
    return np.asarray(np.sqrt(np.mean(np.abs(H - H.mean(axis=0)) ** 2, axis=0) * len(models) / (len(models) - 1)))


def spread(models: tuple[StateSpace, ...], measures: Callable[[StateSpace], Array]) -> Array:
    """Return the standard deviation of measures (...,) over sampled models (...,)."""
    return np.asarray(np.std(np.stack([measures(model) for model in models]), axis=0, ddof=1))


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
        inside = (frequency >= band[0]) & (frequency <= band[1])
        spectra = np.asarray(np.fft.rfft(rows, axis=1)[:, inside], dtype=np.complex128)
        return cls(tuple(names), np.asarray(frequency[inside], dtype=np.float64), spectra)

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
    """Return the uncertainty of every output, from a number of models with resampled noise, at least 2.

    The standard deviations due to noise are multiplied by the misfit where it is larger than noise explains. The first
    test drives the setups. `with_friction` is the mean square of the part that no linear response explains, with
    friction relative to without, by output.
    """
    models = sampled_models(found, samples)
    response, measure = relative_deviations(found.model, models, tests[0], experiment, found.band)
    # Displacements are not fitted and have the misfit of the velocity.
    velocities, trusts = integrals(found.model.output_names), {}
    for k, name in enumerate(found.model.output_names):
        misfit, left = found.excess[velocities.get(name, name)], with_friction.get(name)
        times, rest = max(misfit, 1.0), None if left is None else float(left**0.5)
        trusts[name] = OutputTrust(float(response[k] * times), float(measure[k] * times), misfit, rest)
    return trusts


def relative_deviations(
    model: StateSpace,
    models: tuple[StateSpace, ...],
    test: TimeSeries,
    experiment: Experiment,
    band: tuple[float, float],
) -> tuple[Array, Array]:
    """Return the relative standard deviations over sampled models of each output's responses (p,) and RMS (p,).

    All inputs have equal weight in the responses; `test` drives the setups; `band` is that of the fit [Hz].
    """
    frequency = np.geomspace(*band, _FREQUENCIES)
    whole = np.maximum(np.mean(np.abs(model.frequency_response(frequency)) ** 2, axis=2), 1e-300)
    parts = np.mean(response_deviation(models, frequency) ** 2, axis=2) / whole
    drive = Excitation.of(test, experiment.rig, band)
    sizes = drive.rms(model, experiment.baseline_damping)
    scatter = spread(models, lambda one: drive.rms(one, experiment.baseline_damping))
    return np.sqrt(np.mean(parts, axis=1)), np.asarray((scatter / np.maximum(sizes, 1e-300)).max(axis=0))


# ==== Effects in the car that a model does not have ==================================================================

#: Misfit, in standard deviations of the estimate, above which it is reported as more than noise [1].
EXCESS = 1.5

#: Unexplained part of an output above which it is reported, and coherence above which it is good [1].
_NOISY, _FINE = 0.05, 0.95


def unmodelled(
    response: FrequencyResponse, found: CommonPoleModel, tests: Sequence[TimeSeries], means: Mapping[str, float]
) -> dict[str, str]:
    """Return one sentence for each sign of an effect that is not in the model, by kind of effect.

    The tests have no means; `means` are the mean tire forces that the original records had [N], by channel.
    """
    sentences, worst = {}, dict[str, float]()
    for name, value in found.excess.items():
        quantity = name.rpartition(".")[2]
        worst[quantity] = max(value, worst.get(quantity, 0.0))
    if listed := ", ".join(f"{quantity} {value:.1f}" for quantity, value in worst.items() if value > EXCESS):
        sentences["misfit"] = (
            f"The misfit is larger than noise (in standard deviations, worst of each: {listed}). Likely causes are "
            "nonlinear effects, above all stick-slip, or too few states. The reported standard deviations are "
            "increased accordingly."
        )
    if listed := ", ".join(sorted(lifted_tires(tests, means))):
        sentences["lift-off"] = (
            f"Tires leave the ground ({listed}), which the linear model cannot represent; lower the road's peak."
        )
    if listed := ", ".join(_noisy_outputs(response, found.band)):
        sentences["unexplained"] = (
            f"Not explained by any linear response although coherence is good: {listed} of the output. If the sensors "
            "are less noisy than that, the cause is friction or nonlinear springs."
        )
    return sentences


def _noisy_outputs(response: FrequencyResponse, band: tuple[float, float]) -> Iterator[str]:
    """Yield outputs that are noisy although their coherence is good: a sign of friction or springs."""
    if response.coherence is not None:
        inside = (response.frequency >= band[0]) & (response.frequency <= band[1])
        left = np.sqrt(1.0 - np.median(response.coherence[:, inside], axis=1))
        for name, share in zip(response.output_names, left, strict=True):
            if _NOISY < share < np.sqrt(1.0 - _FINE**2):
                yield f"{name} {100.0 * share:.0f} %"


# ==== The recipe =====================================================================================================

#: Shares of the band that are tried one after the other, if a model cannot be used [1].
_SHARES = (1.0, 0.65)

#: Flag of a vehicle that fails in its own simulation, as all simpler ones did.
_NONE_USABLE = "No model could be used; the first one was kept."


@dataclass(frozen=True, slots=True, eq=False)
class _PortLaws:
    """Laws of the ports that a response is estimated around."""

    friction: FrictionEstimate | None  #: Estimate of the friction; None if it was not estimated.
    springs: Mapping[str, ForceEstimate]  #: Estimate of the nonlinear springs.
    of_ports: Mapping[str, Friction]  #: Friction and springs of the vehicle, by port.

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
        names = {
            "friction that sticks": any(law.bristle.force for law in laws),
            "friction that creeps": any(law.force for law in laws),
            "port springs": any(law.spring for law in laws),
        }
        return " and ".join(name for name, acts in names.items() if acts) or "linear ports"


class _Car(NamedTuple):
    """A vehicle with its fit, the response that was fitted, the laws of its ports, and the band that was found."""

    vehicle: IdentifiedVehicle
    found: CommonPoleModel
    response: FrequencyResponse
    laws: _PortLaws
    supported: SupportedBand | None


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
        """Identify a vehicle; see `VehicleRecipe`.

        Raises:
            InputError: Tests and experiment do not match, or the effects of the inputs cannot be separated.
            TooShortError: The records have too few frequency bins.
        """
        started, rejected = process_time(), list[str]()
        cars = list[_Car]()
        with portion(0.0, 0.78):
            for laws, share in product(self._port_laws(tests, experiment), _SHARES):
                cars.append(self._car(tests, experiment, laws, share))
                fault = fault_in_simulation(cars[-1].vehicle, tests)
                if fault is None:
                    break
                high = cars[-1].found.band[1]
                rejected.append(f"A model with {laws.text} up to {high:.3g} Hz was rejected: {fault}.")
        is_usable = len(rejected) < len(cars)
        with portion(0.78, 1.0):
            fit = self._fit(cars[-1] if is_usable else cars[0], tests, experiment, rejected, is_usable=is_usable)
        return replace(fit, seconds=process_time() - started)

    def _port_laws(self, tests: Sequence[TimeSeries], experiment: Experiment) -> Iterator[_PortLaws]:
        """Yield the laws of the ports, the best first, then simpler ones."""
        searches = [self.friction] if self.friction is not None else []
        for search in searches:
            with portion(0.0, 0.13):
                friction = search.find(tests, experiment)
            laws = _PortLaws(friction, {}, {port: law for port, law in friction.friction.items() if law.acts})
            springs = {} if self.springs is None else self.springs.find(laws.added_to(tests), experiment)
            stiff = port_springs(springs, tests, experiment.ports)
            if stiff:
                added = {port: laws.of_ports.get(port, Friction())._replace(spring=k2) for port, k2 in stiff.items()}
                yield _PortLaws(friction, springs, {**laws.of_ports, **added})
            yield replace(laws, springs=springs)
            if friction.sticks:
                searches.append(search.creeping)
        springs = {} if self.springs is None or self.friction is not None else self.springs.find(tests, experiment)
        yield _PortLaws(None, springs, {})

    def _car(self, tests: Sequence[TimeSeries], experiment: Experiment, laws: _PortLaws, share: float) -> _Car:
        """Return the car for the laws of the ports, fitted in the lower `share` of the band."""
        with portion(0.13, 0.38):
            response = self._response(laws.added_to(tests), experiment)
        supported = None if self.band is None else self.band.of(response)
        fit = replace(self.fit, high=share * (self.fit.high if supported is None else supported.high))
        with portion(0.38, 1.0):
            found = fit.fit(response)
        baseline, static, sources = experiment.baseline_damping, experiment.static, experiment.sources
        vehicle = IdentifiedVehicle(experiment.name, found.model, baseline, static, sources, laws.of_ports)
        return _Car(vehicle, found, response, laws, supported)

    def _fit(
        self,
        car: _Car,
        tests: Sequence[TimeSeries],
        experiment: Experiment,
        rejected: Sequence[str],
        *,
        is_usable: bool,
    ) -> VehicleFit:
        """Return the fit of a car, with notes on those that were `rejected`."""
        found, laws, friction, corrected = car.found, car.laws, car.laws.friction, car.laws.added_to(tests)
        with portion(0.0, 0.5):
            left = {} if friction is None else friction.residual
            outputs = {} if self.samples < 2 else output_trust(
                found, tests, experiment, samples=self.samples, with_friction=left)  # fmt: skip
        with portion(0.5, 1.0):
            measures = {} if self.levels is None else self._measures(self.levels, car, tests, experiment)
        stability = closed_loop_stability(car.vehicle)
        flags = laws.flags | unmodelled(car.response, found, tests, experiment.means)
        if not is_usable:
            flags[UNUSABLE] = _NONE_USABLE
        elif self.levels is not None and not measures:
            flags[UNUSABLE] = NOT_SIMULATED
        unused = friction is not None and not friction.acts
        records = gather(corrected, experiment.inputs, experiment.outputs, experiment.baseline_damping)
        notes = (
            f"{len(found.model.A)} states from {found.band[0]:g} to {found.band[1]:g} Hz",
            *(() if car.supported is None else (car.supported.summary(),)),
            *rejected,
            input_noise(records, found.band).summary(self.estimate),
            *found.notes,
            *(("No significant friction was found at the ports.",) if unused else ()),
            *flags.values(),
            *((self.levels.note(tests, experiment, measures),) if self.levels is not None and measures else ()),
            stability.summary(),
            safe_slopes(found.model, experiment.baseline_damping).summary(),
        )
        forces = {} if friction is None else friction.forces
        return VehicleFit(
            car.vehicle,
            "common-poles",
            car.response,
            found.residual,
            notes,
            stable=stability.stable,
            ranges=ranges_of(tests, experiment, found.band).as_mapping(),
            trust=Trust(outputs, forces, laws.springs, flags, found.orders, self.samples, measures),
        )

    def _measures(
        self, levels: MeasuredLevels, car: _Car, tests: Sequence[TimeSeries], experiment: Experiment
    ) -> dict[str, MeasureUncertainty]:
        """Return the uncertainty of measures on other drives."""
        corrected = car.laws.added_to(tests)

        def refit(places: Sequence[int]) -> IdentifiedVehicle:
            response = self._response([corrected[k] for k in places], experiment)
            return replace(car.vehicle, state_space=refitted(car.found, response, floor=self.fit.floor))

        return levels.uncertainty(car.vehicle, tests, experiment, refit=refit)

    def _response(self, tests: Sequence[TimeSeries], experiment: Experiment) -> FrequencyResponse:
        return estimate_response(
            tests,
            inputs=experiment.inputs,
            outputs=experiment.outputs,
            recipe=self.estimate,
            baseline_damping=experiment.baseline_damping,
        )


RECIPE = CommonPoles()
