"""Recipe grey-box: a physical car with friction that sticks, fitted to outputs in a free-running simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import process_time

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.errors import TooShortError
from eightpost.ident.output_error import (
    Band,
    OutputError,
    OutputErrorFit,
    Parameter,
    ParameterTable,
    Record,
    Shooting,
    Tolerance,
)
from eightpost.ident.response import FrequencyResponse, LocalPolynomial, Recipe, estimate_response
from eightpost.ident.response.input_noise import input_noise
from eightpost.ident.response.records import gather
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.grey_box.car import OPTIONAL, GreyBoxCar, declared
from eightpost.ident.vehicle.grey_box.start import start_values
from eightpost.ident.vehicle.grey_box.uncertainty import output_trust
from eightpost.ident.vehicle.grey_box.vehicle import linear_model, port_laws
from eightpost.ident.vehicle.measured_levels import MeasuredLevels
from eightpost.ident.vehicle.port_laws import with_port_laws
from eightpost.ident.vehicle.ranges import ranges_of
from eightpost.ident.vehicle.springs import MODELLED, nonlinear_spring_sentence
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.ident.vehicle.trust import NOT_SIMULATED, SIGNIFICANT, UNUSABLE, ForceEstimate, Trust
from eightpost.ident.vehicle.vehicle_fit import FittedParameter, VehicleFit
from eightpost.measure_uncertainty import MeasureUncertainty
from eightpost.signals import TimeSeries
from eightpost.vehicle import Friction, IdentifiedVehicle

#: Share of a record where the fit starts, its settling [s], and the shortest record [s].
_BEGIN, _SETTLING, _SHORTEST = 0.05, 2.0, 10.0

#: Smallest mean tire force that is a static load [N]; records of changes from the mean have none.
_LOADED = 200.0


@dataclass(frozen=True, slots=True)
class GreyBox:
    """Recipe that fits the masses, springs, tires and friction of a car."""

    band: Band = field(default_factory=lambda: Band(0.3, 24.0, "hann"))  #: Frequency band of the fit [Hz].
    seconds: tuple[float, float] = (12.0, 30.0)  #: Durations of each record in the base fit and in the final fit [s].
    converged: float = 0.1  #: Largest residual of an output in the base fit from which optional effects are added [1].
    #: Limits of the residual gate.
    limits: Tolerance = field(default_factory=lambda: Tolerance(explained=0.02, residual=0.05))
    #: Values that the team knows, by parameter: value and relative standard deviation, e.g. `{"lf.spring_rate": (2.2e5,
    #: 0.02)}`.
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: Method of estimating the response, which is reported and not fitted.
    estimate: Recipe = field(default_factory=lambda: LocalPolynomial(high=20.0))
    samples: int = 8  #: Number of models with drawn parameters that the standard deviations due to noise come from.
    #: Settings of the uncertainty of measures on other drives; None gives none.
    levels: MeasuredLevels | None = field(default_factory=MeasuredLevels)

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle; see `VehicleRecipe`.

        Raises:
            InputError: The car has no four corners, or an output is not known.
            TooShortError: A record is too short.
        """
        started = process_time()
        return self.vehicle_fit(self.explain(tests, experiment), tests, experiment, started)

    def vehicle_fit(
        self,
        fit: OutputErrorFit,
        tests: Sequence[TimeSeries],
        experiment: Experiment,
        started: float,
        *,
        without_first: OutputErrorFit | None = None,
    ) -> VehicleFit:
        """Return the vehicle of a fit.

        Args:
            fit: Fit of the nonlinear car; see `explain`.
            tests: Records of the fit.
            experiment: Inputs, shock forces and outputs of the tests.
            started: Processor time at the start of the identification [s].
            without_first: Fit to all tests but the first one, if there is one already.
        """
        lawful = self._with_laws_of_the_file(fit, tests, experiment)
        vehicle = self.vehicle(lawful, experiment)
        stability = closed_loop_stability(vehicle)
        springs, band = _springs(fit, tests), (self.band.low, self.band.high)
        response = self._response(tests, experiment, vehicle.friction)
        outputs = output_trust(lawful, tests[0], experiment, response, band, samples=self.samples)
        measures = self._measures(vehicle, (fit, without_first), tests, experiment)
        flags = {} if fit.gate.is_adequate else {"gate": fit.gate.summary()}
        if self.levels is not None and not measures:
            flags[UNUSABLE] = NOT_SIMULATED
        sentence = nonlinear_spring_sentence(springs, held=MODELLED)
        held = {} if sentence is None else {"port springs": sentence}
        return VehicleFit(
            vehicle,
            "grey-box",
            response,
            lawful.residual,
            (
                *_notes(fit, lawful),
                self._input_noise(tests, experiment),
                *flags.values(),
                *held.values(),
                stability.summary(),
            ),
            process_time() - started,
            stability.stable,
            ranges_of(tests, experiment, band).as_mapping(),
            Trust(outputs, _forces(fit), springs, flags | held, None, self.samples, measures),
            _parameters(fit),
        )

    def _measures(
        self,
        vehicle: IdentifiedVehicle,
        fits: tuple[OutputErrorFit, OutputErrorFit | None],
        tests: Sequence[TimeSeries],
        experiment: Experiment,
    ) -> dict[str, MeasureUncertainty]:
        """Return the uncertainty of measures on other drives, from the vehicle and from one without the first test.

        A car has far fewer parameters than the records have data, so that one left-out test is enough. `fits` has the
        fit to all tests, and that without the first one if it exists.
        """
        if self.levels is None:
            return {}

        def refit(kept: Sequence[int]) -> IdentifiedVehicle:
            if 0 in kept:
                return vehicle
            rest, (fit, without) = [tests[k] for k in kept], fits
            found = without or self.explain(rest, experiment, start=fit.values)
            return self.vehicle(self._with_laws_of_the_file(found, rest, experiment), experiment)

        return self.levels.uncertainty(vehicle, tests, experiment, refit=refit)

    def vehicle(self, fit: OutputErrorFit, experiment: Experiment) -> IdentifiedVehicle:
        """Return the vehicle of a fit: a linear model with the bristles and port springs of the car."""
        return IdentifiedVehicle(
            experiment.name, linear_model(fit.values, experiment), experiment.baseline_damping, experiment.static,
            experiment.sources, port_laws(fit.values, experiment),
        )  # fmt: skip

    def explain(
        self, tests: Sequence[TimeSeries], experiment: Experiment, *, start: Mapping[str, float] | None = None
    ) -> OutputErrorFit:
        """Return the fit of the nonlinear car.

        Args:
            tests: Records of rig tests.
            experiment: Inputs, shock forces and outputs of the tests.
            start: Values of a similar car by parameter, which replace the base fit; None: start with the base fit.

        Raises:
            InputError: The car has no four corners, or an output is not known.
            TooShortError: A record is too short.
        """
        table = self._with_priors(declared(start or start_values(tests, experiment), experiment.rig))
        car, unused, engine = _car(experiment, table), _unused(table, experiment), self._engine
        brief, whole = ([_record(test, experiment, s) for test in tests] for s in self.seconds)
        optional: tuple[str, ...] = ()
        if start is None:
            base = engine.fit(car, table.fixed(*unused, *OPTIONAL), brief, outputs=experiment.outputs)
            # Optional effects divert a fit that has not found the car yet.
            optional = () if max(base.residual.values()) <= self.converged else OPTIONAL
            start = base.values
        return replace(engine, passes=2).fit(
            car, table.fixed(*unused, *optional), whole, outputs=experiment.outputs, start=start
        )

    @property
    def _engine(self) -> OutputError:
        shooting = Shooting(evaluations=15, tolerance=1e-4)
        return OutputError(band=self.band, passes=1, difference=1e-4, tolerance=self.limits, shooting=shooting)

    def _with_laws_of_the_file(
        self, fit: OutputErrorFit, tests: Sequence[TimeSeries], experiment: Experiment
    ) -> OutputErrorFit:
        """Return a fit without tires that stiffen, which the file cannot hold, so that other parameters make up for it.

        It is the same fit if no tire stiffens.
        """
        stiffening = [f"{c}.tire_stiffening" for c in CORNERS]
        if not any(_is_significant(fit, name) for name in stiffening):
            return fit
        table = declared({n: v for n, v in fit.values.items() if n not in stiffening}, experiment.rig)
        records = [_record(test, experiment, self.seconds[1]) for test in tests]
        fixed = (*_unused(table, experiment), *stiffening)
        return self._engine.fit(_car(experiment, table), table.fixed(*fixed), records, outputs=experiment.outputs)

    def _input_noise(self, tests: Sequence[TimeSeries], experiment: Experiment) -> str:
        """Return the estimator and its bias by noise of the measured inputs as a sentence."""
        records = gather(tests, experiment.inputs, experiment.outputs, experiment.baseline_damping)
        return input_noise(records, (self.band.low, self.band.high)).summary(self._engine)

    def _with_priors(self, table: ParameterTable) -> ParameterTable:
        table.theta({name: value for name, (value, _) in self.priors.items()})  # refuses names that do not exist
        return ParameterTable(tuple(self._with_prior(parameter) for parameter in table))

    def _with_prior(self, parameter: Parameter) -> Parameter:
        if parameter.name not in self.priors:
            return parameter
        value, relative = self.priors[parameter.name]
        deviation = relative if parameter.is_logarithmic else relative * abs(value)
        return replace(parameter, start=value, prior=deviation)

    def _response(
        self, tests: Sequence[TimeSeries], experiment: Experiment, friction: Mapping[str, Friction]
    ) -> FrequencyResponse:
        return estimate_response(
            [with_port_laws(test, friction) for test in tests],
            inputs=experiment.inputs,
            outputs=experiment.outputs,
            recipe=self.estimate,
            baseline_damping=experiment.baseline_damping,
        )


def _car(experiment: Experiment, table: ParameterTable) -> GreyBoxCar:
    static = np.array([experiment.means.get(channel(c, "tire_force"), np.inf) for c in CORNERS])
    return GreyBoxCar(experiment, table.names, np.where(static > _LOADED, static, np.inf))


def _record(test: TimeSeries, experiment: Experiment, seconds: float) -> Record:
    """Return a part of a test: roads, loads and port forces minus c v; the outputs of the model."""
    rate = test.sample_rate
    begin = round(_BEGIN * len(test))
    count = min(len(test) - begin, round((seconds + _SETTLING) * rate))
    if count < _SHORTEST * rate:
        raise TooShortError(
            f"{experiment.name}: a test of {len(test) / rate:g} s is too short for the recipe grey-box; record at "
            f"least {_SHORTEST / (1.0 - _BEGIN):.0f} s"
        )
    ports = [_port_force(test, c, experiment.baseline_damping[c]) for c in CORNERS]
    loads = [name for name in experiment.rig if not name.endswith("road")]
    inputs = np.column_stack([*(test[channel(c, "road")] for c in CORNERS), *(test[name] for name in loads), *ports])
    outputs = np.column_stack([test[name] for name in experiment.outputs])
    part = slice(begin, begin + count)
    return Record(inputs[part], outputs[part], rate, settling=round(_SETTLING * rate))


def _port_force(test: TimeSeries, corner: str, damping: float) -> Array:
    return np.asarray(test[channel(corner, "force")] - damping * test[channel(corner, "velocity")])


def _unused(table: ParameterTable, experiment: Experiment) -> tuple[str, ...]:
    """Return the parameters that no output depends on."""
    found = [n for n in ("driver_place", "driver_spread") if "driver.acceleration" not in experiment.outputs]
    found += [f"{a}.overhang" for a in ("front", "rear") if f"{a}.ride_height" not in experiment.outputs]
    arms = {"heave_share": "heave_force", "pitch_arm": "pitch_moment",
            "front.roll_arm": "roll_moment", "rear.roll_arm": "roll_moment"}  # fmt: skip
    return tuple(found + [n for n, load in arms.items() if n in table.names and load not in experiment.rig])


def _forces(fit: OutputErrorFit) -> dict[str, ForceEstimate]:
    return {c: ForceEstimate(fit.values[f"{c}.friction"], fit.deviations[f"{c}.friction"]) for c in CORNERS}


def _springs(fit: OutputErrorFit, tests: Sequence[TimeSeries]) -> dict[str, ForceEstimate]:
    """Return the spring force that grows with the square of the travel, at the RMS travel of the wheel."""
    found = {}
    for c in CORNERS:
        name = f"{c}.spring_progression"
        if name not in fit.deviations or channel(c, "displacement") not in tests[0]:
            continue
        travel = float(np.std(tests[0][channel(c, "displacement")])) / fit.values[f"{c}.motion_ratio"]
        size = fit.values[f"{c}.spring_rate"] * travel**2
        found[c] = ForceEstimate(size * fit.values[name], size * fit.deviations[name])
    return found


def _notes(fit: OutputErrorFit, lawful: OutputErrorFit) -> list[str]:
    masses = [fit.values[f"{axle}.mass heave"] for axle in ("front", "rear")]
    sprung = sum(masses) + 2.0 * fit.values["mass coupling heave"]
    notes = [
        f"sprung mass {sprung:.1f} kg; residuals of the simulation are {100 * min(fit.residual.values()):.2g} to "
        f"{100 * max(fit.residual.values()):.2g} % of the outputs",
        "the vehicle file has the friction and the progressive springs at its ports; its tires are linear about the "
        f"mean of the tests and do not lift off. Its residuals are up to {100 * max(lawful.residual.values()):.2g} %",
    ]
    stiffening = [c for c in CORNERS if _is_significant(fit, f"{c}.tire_stiffening")]
    if stiffening:
        notes.append(f"tires stiffen with deflection: {', '.join(stiffening)}")
    if not fit.converged:
        notes.append(f"the search did not converge: {fit.message}")
    if fit.at_bounds:
        notes.append(f"parameters at a bound of the fit, whose intervals are not valid: {', '.join(fit.at_bounds)}")
    return notes


def _is_significant(fit: OutputErrorFit, name: str) -> bool:
    return name in fit.deviations and abs(fit.values[name]) > SIGNIFICANT * fit.deviations[name]


def _parameters(fit: OutputErrorFit) -> tuple[FittedParameter, ...]:
    intervals = fit.intervals()
    return tuple(
        FittedParameter(p.name, p.unit, fit.values[p.name], *intervals[p.name], p.name in fit.at_bounds)
        for p in fit.table.free
    )


RECIPE = GreyBox()
