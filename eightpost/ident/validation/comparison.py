"""Comparison of predicted with measured outputs of a vehicle, and its modes and responses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from eightpost.array_types import Array, Complex
from eightpost.errors import MissingChannelError, ParameterError, TooShortError
from eightpost.ident.preparation import Decimation, Preparation, prepare
from eightpost.ident.validation.records import STANDING, ErrorSpectrum, Kind, Recognition, Record, error_spectrum
from eightpost.ident.vehicle.experiment import quantity
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.ident.vehicle.static_rating import holds
from eightpost.rig import RigConditions, RigTest
from eightpost.signals import TimeSeries
from eightpost.signals.filters import lowpass
from eightpost.uncertainty import TOTAL
from eightpost.vehicle import StateSpace

# ==== Rig records: their drive and kind of test ======================================================================

# ---- Recognition of the kind of test from the drive (6.1.3) ---------------------------------------------------------

#: Fraction of the road power within the relative width `_NEAR` of one frequency from which a record is a sine.
_PURE, _NEAR = 0.9, 0.2

#: An input is constant while it changes by less than this fraction of its range in `_LOOK` [s].
_STILL, _LOOK = 0.01, 0.05

#: Standard deviation of a road input below which it is at rest, above the noise of an LVDT [m].
_AT_REST = 1e-4


def recognise_drive(series: TimeSeries, roads: Sequence[str], loads: Sequence[str]) -> Recognition:
    """Recognise the kind of test of a record without means.

    The kinds are tried in this order: static, if no road moves and the loads are constant at least half of the time;
    sine, if 90 % of the roads' power lies within 20 % of one frequency; bump, if the roads are constant at least half
    of the time; otherwise random.
    """
    road = _rows(series, roads)
    if road.std(axis=1).max(initial=0.0) < _AT_REST:
        share = _standing(_rows(series, loads), series.sample_rate)
        if share >= STANDING:
            return Recognition("static", f"loads constant {100.0 * share:.0f} % of the time, roads at rest")
        return Recognition("random", "roads at rest, loads always moving")
    frequency, share = _one_frequency(road, series.sample_rate)
    if share >= _PURE:
        reason = f"{100.0 * share:.0f} % of the roads' power is near {frequency:.3g} Hz"
        return Recognition("sine", reason, frequency)
    share = _standing(road, series.sample_rate)
    if share >= STANDING:
        return Recognition("bump", f"roads constant {100.0 * share:.0f} % of the time, with steps between")
    return Recognition("random", "roads always moving, at many frequencies")


def _rows(series: TimeSeries, names: Sequence[str]) -> Array:
    return np.stack([series[name] for name in names]) if names else np.zeros((1, len(series)))


def _one_frequency(rows: Array, rate: float) -> tuple[float, float]:
    """Return the strongest frequency [Hz] and the fraction of the power near it."""
    power = np.sum(np.abs(np.fft.rfft(rows * np.hanning(rows.shape[1]), axis=1)) ** 2, axis=0)
    lines = np.fft.rfftfreq(rows.shape[1], 1.0 / rate)
    top = int(np.argmax(power[1:])) + 1
    about = slice(max(top - 2, 0), top + 3)  # the window's main lobe
    frequency = float(lines[about] @ power[about] / power[about].sum())
    width = max(_NEAR * frequency, 3.0 * lines[1])
    near = np.abs(lines - frequency) <= width
    return frequency, float(power[near].sum() / power.sum())


def _standing(rows: Array, rate: float) -> float:
    """Return the fraction of the time in which no row changes."""
    look = max(1, round(_LOOK * rate))
    span = np.ptp(rows, axis=1, keepdims=True)
    change = np.abs(rows[:, look:] - rows[:, :-look])
    return float(np.mean(np.all(change <= _STILL * span.max(), axis=0)))


# ---- Rig records that a vehicle is compared with --------------------------------------------------------------------

#: Approximate rate of prepared records [Hz]: inputs that are linear over 1.6 ms lose 0.3 % at 20 Hz.
RATE = 625.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigRecord(Record):
    """A prepared rig test that a vehicle is compared with."""

    series: TimeSeries  #: Channels at the simulation's rate, without means.
    means: Mapping[str, float]  #: Means by channel, SI.
    conditions: RigConditions  #: Conditions stated in the file.
    #: Notes of the preparation, a sentence each; lags and drifts are reported for random records only.
    notes: tuple[str, ...] = ()


def rig_record(test: RigTest, model: StateSpace, *, kind: Kind | None = None, name: str = "record") -> RigRecord:
    """Return a rig test prepared for a comparison with a vehicle.

    Args:
        test: Rig test.
        model: Vehicle that the record's channels will drive.
        kind: Kind of test; None recognises it from the drive.
        name: Name of the record if it has no file.

    Raises:
        MissingChannelError: A road, a shock force or a shock velocity is missing.
        ParameterError: The kind is sine, but the record has no dominant frequency.
        TooShortError: The record is too short.
    """
    called = test.source.name if test.source else name
    rate = test.series.sample_rate
    factor = max(1, round(rate / RATE)) if model.dt is None else max(1, round(rate * model.dt))
    prepared = prepare([test], Preparation(Decimation(rate / factor)))
    series = prepared.records[0]
    _check_channels(series, model, test, called)
    roads = [name for name in model.input_names if quantity(name) == "road"]
    loads = [n for n in model.input_names if n not in roads and quantity(n) != "force" and n in series]
    found = recognise_drive(series, roads, loads)
    if kind == "sine" and found.frequency is None:
        raise ParameterError(f"{called}: --set kind says that it is a sine, but {found.reason}; omit --set kind")
    if kind is not None and kind != found.kind:
        found = Recognition(kind, "kind given by the user", found.frequency)
    return RigRecord(
        name=called,
        kind=found.kind,
        reason=found.reason,
        frequency=found.frequency,
        digest=test.sha256,
        series=series,
        means=prepared.means[0],
        conditions=test.conditions,
        notes=(*(prepared.notes if found.kind == "random" else ()), *_missing_loads(series, model, called)),
    )


def _check_channels(series: TimeSeries, model: StateSpace, test: RigTest, called: str) -> None:
    needed = [n for n in model.input_names if quantity(n) in ("road", "force")]
    ports = [n.removesuffix("force") for n in needed if quantity(n) == "force"]
    for name in (*needed, *(f"{port}velocity" for port in ports)):
        if name not in series:
            what = f"{called} lacks a channel that the vehicle {model.name!r} needs; is it a record of another car?"
            raise MissingChannelError(what, path=test.source, channel=name)


def _missing_loads(series: TimeSeries, model: StateSpace, called: str) -> tuple[str, ...]:
    lost = [name for name in model.input_names if name not in series]
    if not lost:
        return ()
    return (f"{called}: {', '.join(lost)} is an input of the vehicle but not in the record; assumed constant",)


# ==== Outputs: in a record, over records, in steady motions ==========================================================

# ---- Comparison of predicted and measured outputs in the band of the fit --------------------------------------------

#: Quantities that setups are judged by; the criteria of the verdict apply to them.
JUDGED = ("velocity", "tire_force", "ride_height", TOTAL)

#: An output below this fraction of the largest of its quantity barely moves in a record.
_QUIET = 0.1

#: Order of the low-pass, run forward and backward; time omitted at the end, where the filter rings [s].
_ORDER, _END = 4, 0.5

#: Largest fraction of a record that is omitted for settling [1].
_MOST_SETTLING = 0.25

#: Length of Welch's blocks [s] and the minimum number of them (overlapping by half).
_BLOCK, _FEWEST = 4.0, 6


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Measured and predicted values of one output of one record."""

    name: str  #: Name of the output.
    unit: str  #: SI unit.
    measured: Array  #: Measured values without their mean (N,).
    predicted: Array  #: Predicted values without their mean (N,).
    is_judged: bool  #: Whether the criteria apply: setups are judged by the quantity, and the output moves enough here.

    @property
    def rms(self) -> tuple[float, float]:
        """RMS, measured and predicted."""
        return float(self.measured.std()), float(self.predicted.std())

    @property
    def level(self) -> float:
        """Relative error of the predicted RMS [1]; positive if it is too large."""
        measured, predicted = self.rms
        return predicted / measured - 1.0

    @property
    def error(self) -> float:
        """RMS of measured minus predicted, over the measured RMS [1]."""
        return float((self.measured - self.predicted).std() / self.rms[0])

    @property
    def correlation(self) -> float:
        """Correlation of predicted and measured values [1]; 0 if the prediction is constant."""
        measured, predicted = self.rms
        return float(np.mean(self.measured * self.predicted) / (measured * predicted)) if predicted else 0.0

    def spectrum(self, rate: float, band: float) -> ErrorSpectrum | None:
        """Return the spectra of the error, and its coherence with the prediction.

        The coherence is near 1 if another gain or phase would have predicted the error.
        """
        if not self.predicted.any():
            return None
        return error_spectrum(
            self.measured, self.predicted, self.predicted, rate=rate, band=band, block=_BLOCK, fewest=_FEWEST
        )


@dataclass(frozen=True, slots=True)
class Judging:
    """Band and time span that the criteria apply to."""

    band: float  #: Cut-off frequency of the low-pass that measurement and prediction pass [Hz].
    #: Time omitted at the start, because the car's initial state is not known [s]; at most a quarter of the record.
    settling: float = 4.0

    def inside(self, series: TimeSeries) -> TimeSeries:
        """Return the judged part of a series, low-passed and without means.

        Raises:
            TooShortError: Less than one second is left to be judged.
        """
        rate = series.sample_rate
        rows = lowpass(series.values, rate, min(self.band, 0.4 * rate), order=_ORDER)
        start = min(self.settling, _MOST_SETTLING * series.duration)
        kept = slice(round(start * rate), len(series) - round(_END * rate))
        rows = rows[:, kept]
        if rows.shape[1] < rate:
            raise TooShortError(f"less than 1 s of {series.duration:.3g} s is left to be judged; give a longer record")
        rows = rows - rows.mean(axis=1, keepdims=True)
        channels = {n: (u, row) for n, u, row in zip(series.names, series.units, rows, strict=True)}
        return TimeSeries.from_channels(series.time[kept], channels)


def with_total(series: TimeSeries) -> TimeSeries:
    """Return a series with the sum of its four tire forces added; unchanged if it does not have all four."""
    forces = [series[name] for name in series.names if quantity(name) == "tire_force"]
    return series.with_channel(TOTAL, "N", np.sum(forces, axis=0)) if len(forces) == 4 else series


def compare(measured: TimeSeries, predicted: TimeSeries) -> tuple[Comparison, ...]:
    """Return the comparisons of all outputs that are in both series and not constant in the measurement.

    Both series were processed by `Judging.inside`.
    """
    names = [name for name in predicted.names if name in measured and measured[name].std() > 0.0]
    moving = _moving(measured, names)
    return tuple(
        Comparison(n, measured.unit(n), measured[n], predicted[n], quantity(n) in JUDGED and n in moving) for n in names
    )


def _moving(measured: TimeSeries, names: Iterable[str]) -> set[str]:
    """Return the outputs that move enough, compared with the largest of their quantity."""
    sizes = {name: float(measured[name].std()) for name in names}
    largest: dict[str, float] = {}
    for name, size in sizes.items():
        largest[quantity(name)] = max(size, largest.get(quantity(name), 0.0))
    return {name for name, size in sizes.items() if size >= _QUIET * largest[quantity(name)]}


# ---- Trends of RMS over records, which show whether the vehicle ranks setups as the rig does ------------------------

#: Minimum number of records for a trend.
FEWEST = 3

#: Relative spread below which a measure has no trend.
_FLAT = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """RMS of one output over records."""

    name: str  #: Name of the output.
    unit: str  #: SI unit.
    measured: Array  #: Measured RMS of each record (R,).
    predicted: Array  #: Predicted RMS of each record (R,).

    @property
    def spread(self) -> float:
        """Largest minus smallest measured RMS, over their mean [1]."""
        return float(np.ptp(self.measured) / self.measured.mean())

    @property
    def is_flat(self) -> bool:
        """Whether the records barely differ, so that their order is a matter of chance."""
        return self.spread < _FLAT

    @property
    def correlation(self) -> float:
        """Pearson correlation of predicted and measured RMS [1]."""
        return _correlation(self.measured, self.predicted)

    @property
    def rank(self) -> float:
        """Spearman rank correlation of predicted and measured RMS [1]."""
        return _correlation(rankdata(self.measured), rankdata(self.predicted))

    @property
    def is_reversed(self) -> bool:
        """Whether two records whose RMS differs by 1 % of the mean or more are predicted in the wrong order.

        Records that are closer to each other exchange their ranks by chance, and which one is better hardly matters.
        """
        measured, predicted = (np.subtract.outer(rms, rms) for rms in (self.measured, self.predicted))
        return bool(np.any((measured >= _FLAT * self.measured.mean()) & (predicted < 0.0)))

    @property
    def bias(self) -> float:
        """Mean of predicted over measured RMS, minus one [1]; the trend may be right even if this level is wrong."""
        return float(np.mean(self.predicted / self.measured) - 1.0)

    @property
    def remaining_error(self) -> float:
        """Largest error of RMS relative to its mean over records [1]; the common level error is removed."""
        return float(np.abs(self.predicted / self.predicted.mean() - self.measured / self.measured.mean()).max())


def trends_of(records: Sequence[Sequence[Comparison]]) -> tuple[Trend, ...]:
    """Return the trends of all judged outputs; empty for fewer than three records."""
    if len(records) < FEWEST:
        return ()
    by_name = [{output.name: output for output in outputs} for outputs in records]
    names = [n for n, output in by_name[0].items() if output.is_judged and all(n in other for other in by_name)]
    return tuple(_trend([outputs[name] for outputs in by_name]) for name in sorted(names, key=quantity))


def _trend(outputs: Sequence[Comparison]) -> Trend:
    measured, predicted = np.array([one.rms for one in outputs]).T
    return Trend(outputs[0].name, outputs[0].unit, measured, predicted)


def _correlation(first: Array, second: Array) -> float:
    a, b = first - first.mean(), second - second.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else 0.0


# ---- Sine records ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SineOutput:
    """One output of a sine record."""

    name: str  #: Name of the output.
    unit: str  #: SI unit.
    amplitude: tuple[float, float]  #: Amplitude of the fundamental, measured and predicted.
    phase: float  #: Phase lead of the prediction [rad].
    harmonics: float  #: RMS of the measurement without its fundamental, over the measured RMS [1]; see 6.5.2.

    @property
    def gain(self) -> float:
        """Predicted over measured amplitude [1]."""
        return self.amplitude[1] / self.amplitude[0]


def sine_output(output: Comparison, frequency: float, rate: float) -> SineOutput:
    """Return gain, phase and harmonics of an output of a sine record."""
    turns = 2.0 * np.pi * frequency * np.arange(output.measured.size) / rate
    basis = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    fitted = np.linalg.lstsq(basis, np.stack([output.measured, output.predicted], axis=1), rcond=None)[0]
    measured, predicted = (complex(a, -b) for a, b in fitted.T)
    rest = output.measured - basis @ fitted[:, 0]
    return SineOutput(
        output.name,
        output.unit,
        (abs(measured), abs(predicted)),
        float(np.angle(predicted / measured)) if predicted else 0.0,
        float(rest.std() / output.rms[0]),
    )


# ---- Static records -------------------------------------------------------------------------------------------------

#: Quantities that have a static level.
_STATIC = ("displacement", "tire_force", "ride_height")


@dataclass(frozen=True, slots=True, eq=False)
class StaticOutput:
    """One output over the holds of a static record: times of constant load."""

    name: str  #: Name of the output.
    unit: str  #: SI unit.
    load: Array  #: Sum of all loads during each hold, minus the mean over holds (H,) [N or N.m].
    measured: Array  #: Measured output during each hold, minus the mean over holds (H,).
    predicted: Array  #: Predicted output during each hold, minus the mean over holds (H,).

    @property
    def slopes(self) -> tuple[float, float]:
        """Least-squares change per load, measured and predicted."""
        whole = float(self.load @ self.load)
        if whole == 0.0:
            return 0.0, 0.0
        return float(self.load @ self.measured) / whole, float(self.load @ self.predicted) / whole


def static_outputs(measured: TimeSeries, predicted: TimeSeries, loads: Sequence[str]) -> tuple[StaticOutput, ...]:
    """Return the outputs during the holds; empty if the loads are never constant."""
    there = [name for name in loads if name in measured]
    if not there:
        return ()
    rows = np.stack([measured[name] for name in there])
    held = holds(rows, measured.sample_rate)
    if len(held) < 2:
        return ()
    signs = np.sign(rows @ rows[0])  # in pitch and roll some loads pull while others push
    names = [name for name in predicted.names if name in measured and quantity(name) in _STATIC]
    load = _levels(signs @ rows, held)
    return tuple(
        StaticOutput(n, measured.unit(n), load, _levels(measured[n], held), _levels(predicted[n], held)) for n in names
    )


def _levels(values: Array, held: Sequence[slice]) -> Array:
    found = np.array([values[hold].mean() for hold in held])
    return np.asarray(found - found.mean())


# ==== Modes, and responses beside those that the vehicle was fitted to ===============================================

# ---- Modes of an identified vehicle, matched with those of another car by the modal assurance criterion -------------


@dataclass(frozen=True, slots=True)
class VehicleMode:
    """A mode and the most similar mode of another car."""

    frequency: float  #: Frequency [Hz].
    damping: float  #: Damping ratio [1].
    #: Frequency [Hz] and damping ratio of the other car's mode; None without another car.
    match: tuple[float, float] | None = None
    mac: float | None = None  #: Modal assurance criterion of the two shapes [1]: 1 if they are equal up to a factor.


def modes_of(model: StateSpace, other: StateSpace | None = None) -> tuple[VehicleMode, ...]:
    """Return the oscillating modes, slowest first, each with the mode of another car that has the most similar shape.

        MAC = |a^H b|^2 / (a^H a  b^H b)

    of shapes over the outputs that both cars have. Each output is scaled by its largest value over the model's modes,
    so that the result does not depend on units.

    Args:
        model: Identified vehicle.
        other: True car or another fit, around the same damping.

    Raises:
        ParameterError: The two cars have no output in common.

    Source: R. J. Allemang, "The modal assurance criterion - twenty years of use and abuse", Sound and Vibration 37
    (2003) 14-21.
    """
    names = model.output_names if other is None else [n for n in model.output_names if n in other.output_names]
    if not names:
        raise ParameterError(f"{model.name} has no output in common with the vehicle it is compared with")
    poles, shapes = _shapes(model, names)
    if other is None:
        return tuple(VehicleMode(*_frequency_and_damping(pole)) for pole in poles)
    other_poles, other_shapes = _shapes(other, names)
    scale = np.abs(shapes).max(axis=1, keepdims=True)
    scale[scale == 0.0] = 1.0
    mac = _assurance(shapes / scale, other_shapes / scale)
    modes = []
    for pole, row in zip(poles, mac, strict=True):
        k = int(np.argmax(row)) if row.size else -1
        match = (_frequency_and_damping(other_poles[k]), float(row[k])) if row.size else (None, None)
        modes.append(VehicleMode(*_frequency_and_damping(pole), *match))
    return tuple(modes)


def _shapes(model: StateSpace, names: list[str] | tuple[str, ...]) -> tuple[Complex, Complex]:
    """Return the oscillating poles (n,) [1/s] and their shapes at the outputs (p, n), scaled to unit length."""
    z, V = np.linalg.eig(model.A)
    poles = z if model.dt is None else np.log(z.astype(np.complex128)) / model.dt
    upper = poles.imag > 1e-9 * np.abs(poles).max(initial=0.0)
    order = np.argsort(np.abs(poles[upper]))
    rows = [model.output_names.index(name) for name in names]
    shapes = (model.C[rows] @ V[:, upper])[:, order]
    length = np.linalg.norm(shapes, axis=0)
    return np.asarray(poles[upper][order]), np.asarray(
        shapes / np.where(length > 0.0, length, 1.0), dtype=np.complex128
    )


def _assurance(a: Complex, b: Complex) -> Array:
    """Return the MAC of every pair of columns (n, k)."""
    across = np.abs(a.conj().T @ b) ** 2
    return np.asarray(across / np.outer(np.sum(np.abs(a) ** 2, axis=0), np.sum(np.abs(b) ** 2, axis=0)))


def _frequency_and_damping(pole: complex) -> tuple[float, float]:
    return float(abs(pole) / (2.0 * np.pi)), float(-pole.real / abs(pole))


# ---- Responses of the model and of the estimate that it was fitted to, with coherence and confidence ----------------

#: Half width of a 95 % interval, in standard deviations of a complex number's magnitude.
_WIDE = 1.96 / np.sqrt(2.0)


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Response of an output to an input."""

    output: str  #: Name of the output.
    input: str  #: Name of the input.
    unit: str  #: Unit of the response.
    frequency: Array  #: Frequencies at which the input had power (K,) [Hz].
    estimate: Complex  #: Estimated response (K,).
    model: Complex  #: Response of the model (K,).
    #: 95 % confidence interval of the estimate's magnitude (2, K); None if the estimate has no variance.
    band: Array | None
    coherence: Array | None  #: Multiple coherence of the output (K,) [1]; None if it is not known.

    @property
    def misfit(self) -> float:
        """RMS of model minus estimate, over the RMS of the estimate [1]."""
        return float(np.sqrt(np.sum(np.abs(self.model - self.estimate) ** 2) / np.sum(np.abs(self.estimate) ** 2)))

    @property
    def inside(self) -> float | None:
        """Fraction of frequencies at which the model's magnitude is inside the band [1]; None without a band."""
        if self.band is None:
            return None
        size = np.abs(self.model)
        return float(np.mean((size >= self.band[0]) & (size <= self.band[1])))


def main_paths(response: FrequencyResponse, model: StateSpace, band: tuple[float, float]) -> tuple[Response, ...]:
    """Return the strongest response of every judged quantity's outputs to a road and to a shock force."""
    low, high = max(band[0], float(response.frequency[0])), min(band[1], float(response.frequency[-1]))
    estimate = response.band(low, high)
    outputs = [n for n in estimate.output_names if quantity(n) in JUDGED and n in model.output_names]
    found = []
    for output in outputs:
        for kind in ("road", "force"):
            inputs = [n for n in estimate.input_names if quantity(n) == kind and n in model.input_names]
            if strongest := _strongest(estimate, output, inputs):
                found.append(_path(estimate, model, output, strongest))
    return tuple(found)


def _strongest(estimate: FrequencyResponse, output: str, inputs: list[str]) -> str | None:
    sizes = {name: float(np.sum(np.abs(estimate.between(output, name)) ** 2)) for name in inputs}
    best = max(sizes, key=lambda name: sizes[name], default=None)
    return best if best is not None and sizes[best] > 0.0 else None


def _path(estimate: FrequencyResponse, model: StateSpace, output: str, name: str) -> Response:
    one = estimate.select(inputs=[name], outputs=[output])
    H = one.H[0, 0]
    powered = np.abs(H) > 0.0
    frequency, H = one.frequency[powered], H[powered]
    modelled = model.select(inputs=[name], outputs=[output]).frequency_response(frequency)[0, 0]
    unit = f"({one.outputs[0].unit})/({one.inputs[0].unit})"
    coherence = None if one.coherence is None else one.coherence[0, powered]
    return Response(output, name, unit, frequency, H, modelled, _band(one, powered), coherence)


def _band(one: FrequencyResponse, powered: NDArray[np.bool_]) -> Array | None:
    if one.variance is None:
        return None
    size = np.abs(one.H[0, 0, powered])
    wide = _WIDE * np.sqrt(one.variance[0, 0, powered])
    if not np.isfinite(wide).all():
        return None
    return np.stack([np.maximum(size - wide, 0.0), size + wide])
