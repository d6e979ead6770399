"""Recipe grey-box: a physical car with friction that sticks, fitted to outputs in a free-running simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import process_time
from typing import NamedTuple

import numpy as np
from scipy.stats import f as f_distribution
from scipy.stats import norm

from eightpost.array_types import Array, Complex
from eightpost.corners import CORNERS, channel
from eightpost.errors import TooShortError
from eightpost.ident.grey_box.family import OPTIONAL, GreyBoxCar, declared, linear_model, port_laws, start_values
from eightpost.ident.grey_box.output_error import Band, OutputErrorFit, OutputErrorMethod, ParameterTable, Record
from eightpost.ident.vehicle.common_poles import relative_deviations
from eightpost.ident.vehicle.estimators import LocalPolynomial, estimate_response, input_noise
from eightpost.ident.vehicle.experiment import Experiment, gather, ranges_of
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.ident.vehicle.port_search import MODELLED, nonlinear_spring_sentence
from eightpost.ident.vehicle.simulation import with_port_laws
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.ident.vehicle.trust import (
    NOT_SIMULATED,
    SIGNIFICANT,
    UNUSABLE,
    ForceEstimate,
    MeasuredLevels,
    OutputTrust,
    Trust,
)
from eightpost.ident.vehicle.vehicle_fit import FittedParameter, VehicleFit
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, StateSpace

# ==== Residual gate: whether the inputs still explain a part of the residual =========================================
# In narrow frequency bands the residual's lines are regressed on those of the inputs and of powers of the simulated
# output. The regression is compared with its own remainder (F test), so the noise may have any colour and need not be
# known. A missing mode shows in the inputs, a missing nonlinearity in the powers. What the records do not excite, and a
# missing effect that resembles noise, cannot be seen.

#: Significance level of all tests of a fit together [1].
LEVEL = 1e-3

#: Largest part of the residual that inputs explain, over the RMS of the output [1], even if significant.
EXPLAINED = 0.02

#: Largest residual over the RMS of the output that is accepted as noise [1]; no test separates the two.
RESIDUAL = 0.05

#: Number of lines per regressor and band.
_SPARE = 3

#: Powers of the simulated output among the regressors.
_POWERS = (2, 3)

#: Smallest share of a regressor that the others do not explain, relative to its size [1].
_INDEPENDENT = 1e-6


class OutputGate(NamedTuple):
    """Residual of one output."""

    residual: float  #: RMS of the residual over that of the output [1].
    #: RMS of the part of the residual that the inputs explain, without that of chance, over the output [1].
    explained: float
    upper: float  #: Upper 95 % limit of `explained` [1].
    probability: float  #: Probability of such a relation by chance [1], corrected for the number of bands.
    frequency: float  #: Frequency at which the relation is strongest [Hz].


def failures(outputs: Mapping[str, OutputGate]) -> dict[str, str]:
    """Return a sentence on every output whose residual is neither noise nor too small to matter, by output."""
    sentences = {}
    for name, output in outputs.items():
        if output.probability < LEVEL / len(outputs) and output.upper > EXPLAINED:
            sentences[name] = (
                f"{name}: the inputs explain a part of the residual that is {100 * output.explained:.2g} % of the "
                f"output (limit {100 * EXPLAINED:g} %), most at {output.frequency:.3g} Hz; the model lacks an effect."
            )
        elif output.residual > RESIDUAL:
            sentences[name] = (
                f"{name}: the residual is {100 * output.residual:.2g} % of the output (limit {100 * RESIDUAL:g} %); "
                "it is not known whether this is noise."
            )
    return sentences


def residual_gate(
    names: Sequence[str], records: Sequence[Record], simulated: Sequence[Array], *, band: Band
) -> dict[str, OutputGate]:
    """Return the residuals of simulated outputs (N, Y) of every record, by the outputs' names."""
    outputs = {}
    simulated = [record.counted(signals) for record, signals in zip(records, simulated, strict=True)]
    records = [Record(r.counted(r.inputs), r.counted(r.outputs), r.rate) for r in records]
    for y, name in enumerate(names):
        if not all(np.isfinite(signals[:, y]).all() for signals in simulated):  # the simulation diverged
            outputs[name] = OutputGate(np.inf, np.inf, np.inf, 0.0, 0.0)
            continue
        measured = [(record.outputs[:, y] - record.outputs[:, y].mean(), record.rate) for record in records]
        power = sum(float(np.sum(np.abs(band.lines(signal, rate)) ** 2)) for signal, rate in measured)
        outputs[name] = _judged(list(_tests(records, simulated, y, band)), power)
    return outputs


class _Test(NamedTuple):
    """Regression in one band: centre [Hz], sums of squares explained and left, and their degrees of freedom."""

    frequency: float
    explained: float
    left: float
    regressors: int
    free: int


def _tests(records: Sequence[Record], simulated: Sequence[Array], y: int, band: Band) -> Iterator[_Test]:
    plain = Band(band.low, band.high)  # the window would correlate the lines
    frequency = np.concatenate([plain.frequencies(len(r.inputs), r.rate) for r in records])
    residual = np.concatenate(
        [plain.lines(r.outputs[:, y] - s[:, y], r.rate) for r, s in zip(records, simulated, strict=True)]
    )
    signals = [_regressors(r, s[:, y]) for r, s in zip(records, simulated, strict=True)]
    columns = np.concatenate([plain.lines(x, r.rate) for x, r in zip(signals, records, strict=True)], axis=1).T
    order = np.argsort(frequency, kind="stable")
    order = order[frequency[order] > 0.0]
    frequency, residual, columns = frequency[order], residual[order], columns[order]
    width = _SPARE * columns.shape[1]
    for rows in np.array_split(np.arange(frequency.size), max(1, frequency.size // width)):
        yield _regression(float(frequency[rows].mean()), residual[rows], columns[rows])


def _regressors(record: Record, simulated: Array) -> Array:
    """Return the inputs and the powers of a simulated output (R, N), of unit size."""
    deviation = simulated - simulated.mean()
    deviation = deviation / max(float(deviation.std()), 1e-300)
    rows = np.vstack([record.inputs.T, *(deviation**power for power in _POWERS)])
    rows = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(rows / np.maximum(rows.std(axis=1, keepdims=True), 1e-300))


def _regression(frequency: float, residual: Complex, columns: Complex) -> _Test:
    U, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    rank = int(np.sum(sizes > _INDEPENDENT * sizes[0])) if sizes.size and sizes[0] > 0.0 else 0
    rank = min(rank, residual.size - 1)
    share = U[:, :rank].conj().T @ residual
    explained = float(np.sum(np.abs(share) ** 2))
    left = max(float(np.sum(np.abs(residual) ** 2)) - explained, 1e-300)
    return _Test(frequency, explained, left, rank, residual.size - rank)


def _judged(tests: Sequence[_Test], power: float) -> OutputGate:
    chances = np.array([_chance(test) for test in tests])
    # Stouffer's sum finds a weak relation in all bands, the smallest probability a strong one in few.
    together = float(norm.sf(np.sum(norm.isf(np.clip(chances, 1e-300, 1.0 - 1e-12))) / np.sqrt(chances.size)))
    probability = min(1.0, 2.0 * min(together, float(chances.min()) * chances.size))
    explained, left, regressors, free = np.array([test[1:] for test in tests]).T
    noise = left / free
    surplus = explained - noise * regressors  # without the part of chance
    total = float(surplus.sum())
    spread = np.sqrt(np.sum(noise**2 * regressors * (1.0 + regressors / free)) + 4.0 * max(total, 0.0) * noise.mean())
    return OutputGate(
        float(np.sqrt((explained + left).sum() / power)),
        float(np.sqrt(max(total, 0.0) / power)),
        float(np.sqrt(max(total + norm.ppf(0.95) * spread, 0.0) / power)),
        probability,
        tests[int(np.argmax(surplus))].frequency,
    )


def _chance(test: _Test) -> float:
    if test.regressors == 0 or test.free <= 0:
        return 1.0
    ratio = (test.explained / test.regressors) / (test.left / test.free)
    return float(f_distribution.sf(ratio, 2 * test.regressors, 2 * test.free))


# ==== The recipe =====================================================================================================

#: Frequency band of the fit [Hz].
BAND = Band(0.3, 24.0, "hann")

#: Highest frequency of the estimated response, which is reported and not fitted [Hz].
_HIGH = 20.0

#: Largest residual of an output in the base fit from which optional effects are added [1].
_CONVERGED = 0.1

#: Number of models with drawn parameters that the standard deviations due to noise come from.
_SAMPLES = 8

#: Share of a record where the fit starts, its settling [s], and the shortest record [s].
_BEGIN, _SETTLING, _SHORTEST = 0.05, 2.0, 10.0

#: Smallest mean tire force that is a static load [N]; records of changes from the mean have none.
_LOADED = 200.0


@dataclass(frozen=True, slots=True)
class GreyBox:
    """Recipe that fits the masses, springs, tires and friction of a car."""

    seconds: tuple[float, float] = (12.0, 30.0)  #: Durations of each record in the base fit and in the final fit [s].
    #: Values that the team knows, by parameter: value and relative standard deviation, e.g. `{"lf.spring_rate": (2.2e5,
    #: 0.02)}`.
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle; see `VehicleRecipe`.

        Raises:
            InputError: The car has no four corners, or an output is not known.
            TooShortError: A record is too short.
        """
        started = process_time()
        return self.vehicle_fit(self.explain(tests, experiment), tests, experiment, started)

    def explain(
        self, tests: Sequence[TimeSeries], experiment: Experiment, *, start: Mapping[str, float] | None = None
    ) -> OutputErrorFit:
        """Return the fit of the nonlinear car; `start` has values of a similar car, which replace the base fit."""
        table = self._with_priors(declared(start or start_values(tests, experiment), experiment.rig))
        car, unused = _car(experiment, table), _unused(table, experiment)
        brief, whole = ([_record(test, experiment, seconds) for test in tests] for seconds in self.seconds)
        optional: tuple[str, ...] = ()
        if start is None:
            fixed = table.fixed(*unused, *OPTIONAL)
            base = OutputErrorMethod(BAND, passes=1).fit(car, fixed, brief, experiment.outputs)
            # Optional effects divert a fit that has not found the car yet.
            optional = () if max(base.residual.values()) <= _CONVERGED else OPTIONAL
            start = base.values
        fixed = table.fixed(*unused, *optional)
        return OutputErrorMethod(BAND).fit(car, fixed, whole, experiment.outputs, start=start)

    def vehicle_fit(
        self, fit: OutputErrorFit, tests: Sequence[TimeSeries], experiment: Experiment, started: float
    ) -> VehicleFit:
        """Return the vehicle of a fit of the nonlinear car, which began at a processor time [s]."""
        lawful = self._with_laws_of_the_file(fit, tests, experiment)
        vehicle = _vehicle(lawful, experiment)
        stability = closed_loop_stability(vehicle)
        springs, band = _springs(fit, tests), (BAND.low, BAND.high)
        response = estimate_response(
            [with_port_laws(test, vehicle.friction) for test in tests],
            inputs=experiment.inputs,
            outputs=experiment.outputs,
            recipe=LocalPolynomial(high=_HIGH),
            baseline_damping=experiment.baseline_damping,
        )
        outputs = _output_trust(lawful, tests[0], experiment, response)

        def refit(kept: Sequence[int]) -> IdentifiedVehicle:
            if 0 in kept:  # a car has far fewer parameters than the records have data: one left-out test is enough
                return vehicle
            rest = [tests[k] for k in kept]
            without = self.explain(rest, experiment, start=fit.values)
            return _vehicle(self._with_laws_of_the_file(without, rest, experiment), experiment)

        measures = MeasuredLevels().uncertainty(vehicle, tests, experiment, refit=refit)
        whole = [_record(test, experiment, self.seconds[1]) for test in tests]
        failed = failures(residual_gate(experiment.outputs, whole, fit.simulated, band=BAND))
        flags = {"gate": " ".join(failed.values())} if failed else {}
        if not measures:
            flags[UNUSABLE] = NOT_SIMULATED
        sentence = nonlinear_spring_sentence(springs, held=MODELLED)
        of_springs = {} if sentence is None else {"port springs": sentence}
        records = gather(tests, experiment.inputs, experiment.outputs, experiment.baseline_damping)
        noise = input_noise(records, band).summary(OutputErrorMethod())
        return VehicleFit(
            vehicle,
            "grey-box",
            response,
            lawful.residual,
            (*_notes(fit, lawful), noise, *flags.values(), *of_springs.values(), stability.summary()),
            process_time() - started,
            stability.stable,
            ranges_of(tests, experiment, band).as_mapping(),
            Trust(outputs, _forces(fit), springs, flags | of_springs, None, _SAMPLES, measures),
            _parameters(fit),
        )

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
        method = OutputErrorMethod(BAND, passes=1)
        return method.fit(_car(experiment, table), table.fixed(*fixed), records, experiment.outputs)

    def _with_priors(self, table: ParameterTable) -> ParameterTable:
        table.check(self.priors)
        rows = {parameter.name: parameter for parameter in table}
        for name, (value, relative) in self.priors.items():
            deviation = relative if rows[name].size is None else relative * abs(value)
            rows[name] = replace(rows[name], start=value, prior=deviation)
        return ParameterTable(tuple(rows.values()))


# ---- Records and model ----------------------------------------------------------------------------------------------


def _vehicle(fit: OutputErrorFit, experiment: Experiment) -> IdentifiedVehicle:
    """Return the vehicle of a fit: a linear model with the bristles and port springs of the car."""
    return IdentifiedVehicle(
        experiment.name, linear_model(fit.values, experiment), experiment.baseline_damping, experiment.static,
        experiment.sources, port_laws(fit.values, experiment),
    )  # fmt: skip


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
    damping = experiment.baseline_damping
    ports = [test[channel(c, "force")] - damping[c] * test[channel(c, "velocity")] for c in CORNERS]
    loads = [name for name in experiment.rig if not name.endswith("road")]
    inputs = np.column_stack([*(test[channel(c, "road")] for c in CORNERS), *(test[name] for name in loads), *ports])
    outputs = np.column_stack([test[name] for name in experiment.outputs])
    part = slice(begin, begin + count)
    return Record(inputs[part], outputs[part], rate, settling=round(_SETTLING * rate))


def _unused(table: ParameterTable, experiment: Experiment) -> tuple[str, ...]:
    """Return the parameters that no output depends on."""
    found = [n for n in ("driver_place", "driver_spread") if "driver.acceleration" not in experiment.outputs]
    found += [f"{a}.overhang" for a in ("front", "rear") if f"{a}.ride_height" not in experiment.outputs]
    arms = {"heave_share": "heave_force", "pitch_arm": "pitch_moment",
            "front.roll_arm": "roll_moment", "rear.roll_arm": "roll_moment"}  # fmt: skip
    return tuple(found + [n for n, load in arms.items() if n in table.names and load not in experiment.rig])


# ---- What the fit states --------------------------------------------------------------------------------------------


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
    if fit.message:
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


def sampled_cars(fit: OutputErrorFit, experiment: Experiment, count: int) -> tuple[StateSpace, ...]:
    """Return a number of linear models with parameters drawn from the covariance of a fit, within their bounds."""
    power, axes = np.linalg.eigh(fit.covariance)
    drawn = np.random.default_rng(0).standard_normal((count, power.size)) * np.sqrt(np.maximum(power, 0.0))
    table = fit.table
    values = [table.values(table.inside(fit.theta + axes @ row)) for row in drawn]
    return tuple(linear_model(dict(zip(table.names, map(float, row), strict=True)), experiment) for row in values)


def _output_trust(
    fit: OutputErrorFit, test: TimeSeries, experiment: Experiment, response: FrequencyResponse
) -> dict[str, OutputTrust]:
    """Return the uncertainty of every output due to noise, from models with drawn parameters, driven by a test."""
    model, band = linear_model(fit.values, experiment), (BAND.low, BAND.high)
    deviations = relative_deviations(model, sampled_cars(fit, experiment, _SAMPLES), test, experiment, band)
    rows = zip(model.output_names, *deviations, _misfit(model, response, band), strict=True)
    return {name: OutputTrust(float(a), float(b), float(c)) for name, a, b, c in rows}


def _misfit(model: StateSpace, response: FrequencyResponse, band: tuple[float, float]) -> Array:
    """Return the RMS of model minus response in standard deviations of the response (p,)."""
    inside = (response.frequency >= band[0]) & (response.frequency <= band[1])
    assert response.variance is not None
    variance = response.variance[..., inside]
    apart = np.abs(model.frequency_response(response.frequency[inside]) - response.H[..., inside]) ** 2
    known = np.isfinite(variance) & (variance > 0.0)
    parts = np.divide(apart, variance, out=np.zeros_like(apart), where=known)
    return np.asarray(np.sqrt(parts.sum(axis=(1, 2)) / np.maximum(known.sum(axis=(1, 2)), 1)))


RECIPE = GreyBox()
