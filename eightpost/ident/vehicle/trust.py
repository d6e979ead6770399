"""Uncertainty of an identified vehicle: errors of levels, measured on tests in closed loop, and what its fit stores."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import StepError
from eightpost.ident.vehicle.experiment import OTHER_SHOCK, Experiment, port_slope, quantity
from eightpost.ident.vehicle.simulation import around_dampers, free_running
from eightpost.progress import parts
from eightpost.signals import TimeSeries
from eightpost.uncertainty import EMPTY, TOTAL, MeasuredLevel, MeasureUncertainty, band_shares, separation
from eightpost.vehicle import IdentifiedVehicle, StateSpace
from eightpost.verdict import listed

#: Flag of a vehicle that cannot be simulated, so that no setup can be predicted.
UNUSABLE = "unusable"

#: Its sentence on a vehicle that cannot be simulated with the shocks of its own tests.
NOT_SIMULATED = (
    "A test could not be simulated with its own shocks in the loop, so the accuracy of predicted measures is not known."
)

#: Number of standard deviations above which a force is significant [1].
SIGNIFICANT = 4.0


class PolePair(NamedTuple):
    """Pole pair of a model: frequency [Hz], damping ratio [1], and whether the next lower order has it too."""

    frequency: float
    damping: float
    steady: bool


class OrderCandidate(NamedTuple):
    """Model of one order: number of states, ratio of its singular value to the next one, and its poles."""

    states: int
    gap: float
    poles: tuple[PolePair, ...]


@dataclass(frozen=True, slots=True)
class Orders:
    """Choice of the number of states."""

    tried: tuple[OrderCandidate, ...]  #: Models of increasing order.
    chosen: int  #: Number of states of the chosen model, without the lags.
    #: Whether a clear gap of the singular values gives the order; otherwise the description length does.
    is_clear: bool
    high: float  #: Highest frequency of the fit [Hz].


@dataclass(frozen=True, slots=True)
class ForceEstimate:
    """Estimated force at a port."""

    value: float  #: Force [N].
    deviation: float  #: Standard deviation of the force [N].

    @property
    def is_significant(self) -> bool:
        """Whether the force is significant, i.e. not explained by noise."""
        return abs(self.value) > SIGNIFICANT * self.deviation

    @property
    def text(self) -> str:
        """The force and twice its standard deviation as text."""
        return f"{self.value:.1f} +- {2.0 * self.deviation:.1f} N"


@dataclass(frozen=True, slots=True)
class OutputTrust:
    """Uncertainty of one output."""

    response: float  #: Relative standard deviation of the model's responses, RMS over inputs and frequencies [1].
    #: Relative standard deviation of the output's RMS on the drive of the tests [1]; the largest value with linear
    #: dampers of half, one and two times the baseline damping.
    measure: float
    misfit: float  #: RMS of model minus estimate in standard deviations of the estimate; 1 if noise explains it.
    #: RMS of the part that no linear response explains, with friction at the ports relative to without [1]; None if
    #: friction was not estimated.
    with_friction: float | None = None


@dataclass(frozen=True, slots=True)
class Trust:
    """Uncertainty and limits of a fit."""

    outputs: Mapping[str, OutputTrust]  #: Uncertainty by output.
    #: Estimated sliding friction by port, significant or not; empty if friction was not estimated.
    friction: Mapping[str, ForceEstimate] = field(default_factory=dict)
    #: Spring force that grows with the square of the travel, at the RMS travel, by port; empty if it was not estimated.
    springs: Mapping[str, ForceEstimate] = field(default_factory=dict)
    #: Sentences on effects in the car that a linear model does not have, by `friction`, `springs`, `lift-off`, `misfit`
    #: and `unexplained`; and why it cannot be simulated, by `UNUSABLE`.
    flags: Mapping[str, str] = field(default_factory=dict)
    orders: Orders | None = None  #: Choice of the number of states.
    samples: int = 0  #: Number of models with resampled noise or drawn parameters that give the standard deviations.
    #: Uncertainty of RMS measures of setups on other drives, by measure: the outputs and the sum of the tire forces;
    #: empty if it was not estimated.
    measures: Mapping[str, MeasureUncertainty] = field(default_factory=dict)


# ---- Noise in the residual: that of the measured outputs, and that of the inputs ------------------------------------

#: Highest frequency below the edge of the decimation's filter, relative to the sample rate [1].
HIGHEST = 0.39

#: Width of the bands in which the noise of a channel is sought [Hz].
_BAND = 5.0

#: Number of frequencies at which the model's response is evaluated.
_FREQUENCIES = 200


def _residual_noise(
    model: StateSpace, test: TimeSeries, slopes: Mapping[str, float], combined: Array
) -> tuple[Array, Array]:
    """Return the expected power of noise at each line of the spectra of measured outputs (q,) and residuals (q, K).

    The noise of a channel is white, with the lowest mean power over bands of 5 Hz. With `u` the inputs of the rig and
    `F - c v` the force of a port with the damping c [N.s/m], the residual of an output y contains

        e = H n_u + H_F (n_F - c n_v) - n_y

    Sums of outputs are judged (q, p), such as the identity (`combined`).
    """
    power = {name: _floor(test[name], test.sample_rate) for name in test.names}
    names, lines = model.output_names, np.fft.rfftfreq(len(test), 1.0 / test.sample_rate)
    coarse = np.linspace(lines[1], lines[-1], _FREQUENCIES)
    H = np.einsum("qp,pmk->mqk", combined, model.frequency_response(coarse))
    H = dict(zip(model.input_names, H, strict=True))
    # Response of the residual to the noise of each channel: an output's own noise, an input, or both for a velocity.
    gains = {name: -combined[:, [k]] + np.zeros(coarse.size) for k, name in enumerate(names)}
    for name in [name for name in H if name in test]:
        gains[name] = gains.get(name, 0.0) + H[name]
    for port, slope in slopes.items():
        velocity = channel(port, "velocity")
        gains[velocity] = gains.get(velocity, 0.0) - slope * H[channel(port, "force")]
    found = np.sum([power[name] * np.abs(gain) ** 2 for name, gain in gains.items()], axis=0)
    measured = combined**2 @ np.array([power[name] for name in names])
    return measured, np.stack([np.interp(lines, coarse, row) for row in found])


def _spectral_power(rows: Array) -> Array:
    """Return the power of the lines of the spectra of signals (p, N) without means, with a Hann window (p, K)."""
    centred = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(np.abs(np.fft.rfft(centred * np.hanning(rows.shape[1]), axis=1)) ** 2)


def _floor(values: Array, rate: float) -> float:
    """Return the lowest mean power of a signal's lines over bands of 5 Hz: white noise is not below it."""
    power = _spectral_power(values[None])[0]
    frequency = np.fft.rfftfreq(values.size, 1.0 / rate)
    power = power[frequency <= HIGHEST * rate]
    width = min(max(1, round(_BAND / frequency[1])), power.size)
    count = power.size // width
    return float(power[: count * width].reshape(count, width).mean(axis=1).min())


# ---- Errors of levels -----------------------------------------------------------------------------------------------

#: Identifies a vehicle from some of the tests, given their indices.
Refit = Callable[[Sequence[int]], IdentifiedVehicle]

#: Smallest power of a band without noise, relative to that with noise [1]: its noise is not known better.
_SMALLEST = 0.02

#: Ratio of the levels, simulated to measured, from which a simulation has diverged [1].
_DIVERGED = 3.0

#: Variance of the tests' mean error as an error of unseen setups, and squared scale of the error between two setups,
#: relative to what the tests show; smallest scales of both, of integration steps and laws at the ports [1]
#: (docs/explanation/vehicle_uncertainty.md).
_OF_MEAN, _OF_OWN, _LEAST, _LEAST_OWN = 0.33, 0.5, 1e-3, 7e-4


class Powers(NamedTuple):
    """Power of each measure in the bands of `band_shares` (q, bands), without noise."""

    simulated: Array
    measured: Array

    @property
    def error(self) -> Array:
        """Error of the level of each measure, ln(simulated / measured) (q,)."""
        return np.asarray(0.5 * np.log(self.simulated.sum(axis=1) / self.measured.sum(axis=1)))

    @property
    def shares(self) -> Array:
        """Shares of the measured power in the bands (q, bands)."""
        return np.asarray(self.measured / self.measured.sum(axis=1, keepdims=True))

    @property
    def spread(self) -> Array:
        """Standard deviation of the error over the bands that are not empty, weighted by their power (q,).

        In an empty band, noise and the model's extrapolation decide the error, which says nothing on the other bands.
        """
        errors = 0.5 * np.log(self.simulated / self.measured)
        weights = np.where(self.shares < EMPTY, 0.0, self.shares)
        weights /= weights.sum(axis=1, keepdims=True)
        middle = np.sum(weights * errors, axis=1, keepdims=True)
        return np.asarray(np.sqrt(np.sum(weights * (errors - middle) ** 2, axis=1)))


@dataclass(frozen=True, slots=True)
class MeasuredLevels:
    """Uncertainty of measures from simulations of the tests, some of them left out of the identification."""

    seconds: float = 60.0  #: Longest part of a test that is simulated, from its start [s].
    settling: float = 4.0  #: Time at the start that is left out, because the simulation starts at rest [s].

    def uncertainty(
        self,
        vehicle: IdentifiedVehicle,
        tests: Sequence[TimeSeries],
        experiment: Experiment,
        *,
        refit: Refit | None = None,
    ) -> dict[str, MeasureUncertainty]:
        """Return the uncertainty of the RMS of every output and of the tire forces' sum; empty if it is not known.

        `refit` identifies the vehicle from some of the tests. A test is left out if every port has two different shocks
        without it. None simulates all tests with `vehicle`, which also replaces one that cannot be simulated. It is not
        known if the simulation of a test with `vehicle` diverges or does not converge.
        """
        left = () if refit is None else removable_tests(tests, experiment.ports)
        found = []
        for k, test in parts(list(enumerate(tests))):
            others = [i for i in range(len(tests)) if i != k]
            powers = self._bounded(refit(others), test) if refit is not None and k in left else None
            powers = powers or self._bounded(vehicle, test)
            if powers is None:
                return {}
            found.append(powers)
        return dict(zip(measure_names(vehicle.state_space.output_names), _uncertainties(found), strict=True))

    def with_records(
        self, known: Mapping[str, MeasureUncertainty], vehicle: IdentifiedVehicle, records: Sequence[TimeSeries]
    ) -> dict[str, MeasureUncertainty]:
        """Return uncertainties that include the errors of records that the vehicle was not identified from.

        The error of one record is that of its setup. Records without all outputs, or that cannot be simulated, show
        none. A record counts once.
        """
        found, outputs = dict(known), vehicle.state_space.output_names
        for record in records:
            powers = self._bounded(vehicle, record) if set(outputs) <= set(record.names) else None
            if powers is not None:
                rows = zip(measure_names(outputs), powers.error, powers.shares, strict=True)
                found |= {name: _with_record(found[name], float(e), tuple(w.tolist())) for name, e, w in rows}
        return found

    def note(self, tests: Sequence[TimeSeries], experiment: Experiment, found: Mapping[str, MeasureUncertainty]) -> str:
        """Return which tests were left out, and which predictions are corrected, as sentences."""
        left = removable_tests(tests, experiment.ports)
        shown = f"test {listed(str(k + 1) for k in left)} predicted by a fit without it" if left else "no test left out"
        biases = [f"{name} {-100.0 * one.bias:+.2g} %" for name, one in found.items() if one.bias]
        corrected = f" Studies of drives like these correct {', '.join(biases)}." if biases else ""
        return f"Levels of {len(tests)} tests, simulated with their shocks in the loop, {shown}.{corrected}"

    def _bounded(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> Powers | None:
        """Return the powers of a test; None if the simulation diverges or does not converge."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                found = self.powers(vehicle, test)
        except StepError:
            return None
        return found if np.all(np.abs(found.error) < np.log(_DIVERGED)) else None

    def outputs(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[Array, Array]:
        """Return the simulated and the measured outputs of a test (p, N), without means, in the model's order.

        Raises:
            StepError: The simulation does not converge.
        """
        part, kept = self._part(test, 0.0), slice(round(self.settling * test.sample_rate), None)
        both = free_running(vehicle, part, tuple(vehicle.baseline_damping)), part
        rows = (np.stack([one[n] for n in vehicle.state_space.output_names])[:, kept] for one in both)
        simulated, measured = (one - one.mean(axis=1, keepdims=True) for one in rows)
        return simulated, measured

    def _part(self, test: TimeSeries, start: float) -> TimeSeries:
        samples = slice(*(round(time * test.sample_rate) for time in (start, self.seconds)))
        return TimeSeries(test.time[samples], test.values[:, samples], test.names, test.units)

    def powers(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> Powers:
        """Return the simulated and measured power of a test, up to the edge of the decimation's filter.

        The noise of the measured inputs is removed from the simulated power, that of the outputs from the measured one.

        Raises:
            StepError: The simulation does not converge.
        """
        slopes = {port: port_slope(self._part(test, 0.0), port) for port in vehicle.baseline_damping}
        model = around_dampers(vehicle, slopes).state_space
        sums = _sums(model.output_names)
        simulated, measured = (sums @ rows for rows in self.outputs(vehicle, test))
        own, noise = _residual_noise(model, self._part(test, self.settling), slopes, sums)
        frequency = np.fft.rfftfreq(measured.shape[1], 1.0 / test.sample_rate).astype(np.float64)
        kept = frequency <= HIGHEST * test.sample_rate
        white = np.repeat(own[:, None], frequency.size, axis=1)
        bands = []
        for rows, floor in ((simulated, noise - white), (measured, white)):
            power, lost = (band_shares(lines[:, kept], frequency[kept]) for lines in (_spectral_power(rows), floor))
            bands.append(np.maximum(np.maximum(power - lost, _SMALLEST * power), np.finfo(float).tiny))
        return Powers(*bands)


def level_errors(measures: Mapping[str, MeasureUncertainty]) -> dict[str, float]:
    """Return the RMS over the tests of the error of each measure's level [1]; empty if no errors were measured.

    It includes the errors by which studies correct their predictions: a model that needs a correction is wrong.
    """
    return {name: math.hypot(one.levels[0].error, _of_setup(one.levels[0])) for name, one in measures.items()
            if one.levels}  # fmt: skip


def _of_setup(tests: MeasuredLevel) -> float:
    """Return the standard deviation of the error of one setup, given that of the mean error of the tests."""
    return tests.deviation / math.sqrt(_OF_MEAN)


def _uncertainties(found: Sequence[Powers]) -> list[MeasureUncertainty]:
    """Return the uncertainty of each measure from the powers of all tests."""
    errors = np.array([one.error for one in found])
    whole = Powers(*np.sum(found, axis=0))
    deviation = np.sqrt(_OF_MEAN * _pooled(_variance(errors), len(found)) + _LEAST**2)
    own = np.sqrt(_OF_OWN * _pooled(_own_squares(found, errors), len(found)) + _LEAST_OWN**2)
    spread = np.sqrt(_pooled(whole.spread**2, len(found)))
    rows = zip(errors.mean(axis=0), deviation, spread, whole.shares, own, strict=True)
    return [
        MeasureUncertainty.of_levels([MeasuredLevel(float(e), float(d), float(s), tuple(w.tolist()))], float(o))
        for e, d, s, w, o in rows
    ]


def _variance(errors: Array) -> Array:
    """Return the variance of the errors of tests (n, q) over the tests (q,); one test has the square of its error."""
    return np.asarray(errors.var(axis=0, ddof=1) if len(errors) > 1 else errors[0] ** 2)


def _with_record(known: MeasureUncertainty, error: float, shares: tuple[float, ...]) -> MeasureUncertainty:
    """Return an uncertainty with the error of one more record; it is `known` if that has no errors or this one."""
    if not known.levels:
        return known
    tests = known.levels[0]
    level = replace(tests, error=error, deviation=_of_setup(tests), shares=shares)
    return known if level in known.levels else MeasureUncertainty.of_levels((*known.levels, level), known.own)


def _own_squares(found: Sequence[Powers], errors: Array) -> Array:
    """Return the squared difference of two tests' errors relative to their squared separation, by measure (q,).

    One test has the square of its error, as if a test one unit apart had none.
    """
    if len(found) == 1:
        return np.asarray(errors[0] ** 2)
    levels = np.array([0.5 * np.log(one.measured.sum(axis=1)) for one in found])
    first, second = np.triu_indices(len(found), 1)
    changes = levels[first] - levels[second]
    distances = np.sqrt(np.mean(changes**2, axis=1))
    apart = np.vectorize(separation)(distances[:, None], changes)
    return np.asarray(np.sum((errors[first] - errors[second]) ** 2, axis=0) / np.sum(apart**2, axis=0))


def _pooled(squares: Array, count: int) -> Array:
    """Return variances of `count` tests (q,), drawn towards their geometric mean as if it were one more test.

    Their mean would be that of the worst measures, which says little about the others.
    """
    usual, freedom = np.exp(np.mean(np.log(np.maximum(squares, np.finfo(float).tiny)))), max(count - 1, 1)
    return np.asarray((freedom * squares + usual) / (freedom + 1))


def measure_names(outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the measures of outputs: the outputs, and the sum of the tire forces of several wheels."""
    return (*outputs, TOTAL) if len(_tires(outputs)) > 1 else tuple(outputs)


def removable_tests(tests: Sequence[TimeSeries], ports: Sequence[str]) -> tuple[int, ...]:
    """Return the indices of the tests without which every port still has two different shocks.

    With linear dampers, the effect of a port's force cannot be separated from tests that all have the same shock there.
    """
    if len(tests) < 2:
        return ()
    slopes = np.array([[port_slope(test, port) for port in ports] for test in tests])
    others = [np.delete(slopes, k, axis=0) for k in range(len(tests))]
    return tuple(
        k for k, rest in enumerate(others) if np.all(np.ptp(rest, axis=0) > OTHER_SHOCK * np.abs(rest).min(axis=0))
    )


def _tires(outputs: Sequence[str]) -> list[int]:
    return [k for k, name in enumerate(outputs) if quantity(name) == "tire_force"]


def _sums(outputs: Sequence[str]) -> Array:
    """Return the sums of outputs that are measures (q, p): each output, and the tire forces together."""
    tires = np.isin(np.arange(len(outputs)), _tires(outputs)).astype(np.float64)
    single = np.eye(len(outputs))
    return np.vstack([single, tires]) if tires.sum() > 1.0 else single
