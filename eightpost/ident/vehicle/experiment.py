"""Experiments that a vehicle is identified from: records in blocks, the ranges they cover, the band they support."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import get_window

from eightpost.array_types import Array, Complex
from eightpost.corners import CORNERS, channel
from eightpost.errors import DataError, InputError, ParameterError, TooShortError
from eightpost.ident.preparation import Prepared
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.signals import TimeSeries
from eightpost.signals.filters import lowpass
from eightpost.vehicle.statespace import Channel

# ==== Records in blocks ==============================================================================================

# ---- Windowed, overlapping blocks and their spectra -----------------------------------------------------------------


class Spectra(NamedTuple):
    """Spectra of all blocks of all tests."""

    frequency: Array  #: Frequencies (K,) [Hz].
    U: Complex  #: Spectra of the inputs (K, R, m).
    Y: Complex  #: Spectra of the outputs (K, R, p).
    test: NDArray[np.intp]  #: Index of the test that each block belongs to (R,).
    independent: float  #: Number of independent blocks that is equivalent to the R overlapping ones.


@dataclass(frozen=True, slots=True)
class Blocks:
    """Division of records into blocks."""

    #: Length of a block [s]; the frequencies are 1 / length apart. Short blocks have leakage: if a mode rings for as
    #: long as the block lasts, its peak is smeared and its damping ratio is estimated too large.
    length: float
    window: str = "hann"  #: Window, any of `scipy.signal.get_window`; the dissertation uses "hamming".
    overlap: float = 0.5  #: Overlap of neighbouring blocks [1].
    high: float = 30.0  #: Highest frequency [Hz]; the lowest one is 1 / length.

    def __post_init__(self) -> None:
        if not (self.length > 0.0 and 0.0 <= self.overlap < 1.0 and self.high > 0.0):
            raise ParameterError(f"{self}: length and high must be above zero, overlap from 0 to below 1")

    def spectra(self, records: Records) -> Spectra:
        """Return the spectra of the blocks of all records; TooShortError: a record is shorter than a block."""
        size = max(2, round(self.length * records.rate))
        frequency: Array = np.arange(size // 2 + 1, dtype=np.float64) * (records.rate / size)
        kept = np.flatnonzero((frequency > 0.0) & (frequency <= min(self.high, 0.499 * records.rate)))
        window = np.asarray(get_window(self.window, size), dtype=np.float64)
        hop = max(1, round(size * (1.0 - self.overlap)))
        U, Y, test = [], [], []
        for number, (u, y) in enumerate(records.tests):
            if u.shape[1] < size:
                raise TooShortError(
                    f"record {number + 1} has {u.shape[1]} samples, but a block of {self.length:g} s has {size}; use "
                    "shorter blocks"
                )
            starts = range(0, u.shape[1] - size + 1, hop)
            U += [np.fft.rfft(window * u[:, k : k + size])[:, kept] for k in starts]
            Y += [np.fft.rfft(window * y[:, k : k + size])[:, kept] for k in starts]
            test += [number] * len(starts)
        worth = len(test) / _repetition(window, hop, len(test))
        chosen: Array = frequency[kept]
        return Spectra(chosen, _by_frequency(U), _by_frequency(Y), np.array(test, dtype=np.intp), worth)


def _by_frequency(spectra: list[Complex]) -> Complex:
    return np.ascontiguousarray(np.stack(spectra).transpose(2, 0, 1))


def _repetition(window: Array, hop: int, count: int) -> float:
    """Return the ratio of the variances of a mean over overlapping blocks and over separate blocks (Welch)."""
    total, energy = 1.0, float(window @ window)
    for k in range(1, min(count, (window.size - 1) // hop + 1)):
        shared = float(window[k * hop :] @ window[: window.size - k * hop]) / energy
        total += 2.0 * (1.0 - k / count) * shared**2
    return total


# ---- Records of rig tests for estimators ----------------------------------------------------------------------------

#: Relative tolerance between the rates of two records, because loggers round time.
_RATE_TOLERANCE = 1e-3

_FEWEST_SAMPLES = 16


class Record(NamedTuple):
    """One test: inputs (m, N) and outputs (p, N), without means."""

    u: Array
    y: Array


@dataclass(frozen=True, slots=True, eq=False)
class Records:
    """Tests of one vehicle."""

    tests: tuple[Record, ...]  #: One or more tests.
    rate: float  #: Sample rate of all tests [Hz].
    inputs: tuple[Channel, ...]  #: Input channels.
    outputs: tuple[Channel, ...]  #: Output channels.


def gather(
    series: Sequence[TimeSeries],
    inputs: Sequence[str],
    outputs: Sequence[str],
    damping: Mapping[str, float] | None = None,
) -> Records:
    """Collect the channels of several records and remove their means.

    From the force of each port with a `damping` [N.s/m] ("lf", ...; "" is the port of a quarter car), the diagonal of
    C-bar, `c v` is subtracted (Eq 4.24, 5.36, 6.4).

    Raises:
        InputError: There is no record or no channel, or the rates differ.
        DataError: A record is not evenly sampled, or one of its channels has another unit than in the first record.
        TooShortError: A record has too few samples.
        MissingChannelError: A record lacks a channel.
    """
    if not series or not inputs or not outputs:
        raise InputError("a frequency response needs at least one record, one input and one output")
    rates = {channel(port, "force"): (channel(port, "velocity"), c) for port, c in (damping or {}).items()}
    for force in rates:
        if force not in inputs:
            raise InputError(f"a baseline damping is given for {force!r}, which is not an input")
    first = series[0]
    for number, record in enumerate(series, start=1):
        if len(record) < _FEWEST_SAMPLES:
            raise TooShortError(
                f"record {number} has {len(record)} samples; a response needs {_FEWEST_SAMPLES} or more"
            )
        if not record.is_uniform:
            raise DataError(f"record {number} is not evenly sampled; resample it first")
        if abs(record.sample_rate / first.sample_rate - 1.0) > _RATE_TOLERANCE:
            both = f"{record.sample_rate:g} Hz, the first {first.sample_rate:g} Hz"
            raise InputError(f"record {number} has {both}; resample to one rate")
        for name in (*inputs, *outputs):
            if record.unit(name) != first.unit(name):
                what = (
                    f"its unit is {record.unit(name)!r} in record {number}, but {first.unit(name)!r} in the first one"
                )
                raise DataError(what, channel=name)
    tests = tuple(Record(_centred(record, inputs, rates), _centred(record, outputs, {})) for record in series)
    channels = (tuple(Channel(name, first.unit(name)) for name in names) for names in (inputs, outputs))
    return Records(tests, first.sample_rate, *channels)


def _centred(record: TimeSeries, names: Sequence[str], rates: Mapping[str, tuple[str, float]]) -> Array:
    """Return channels (len(names), N) without means; they are copied only once, because they may be large."""
    values = np.empty((len(names), len(record)))
    for i, name in enumerate(names):
        values[i] = record[name]
        if name in rates:
            velocity, rate = rates[name]
            values[i] -= rate * record[velocity]
        values[i] -= values[i].mean()
    return values


# ==== Experiments ====================================================================================================

# ---- Definition of an identification --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Experiment:
    """Channels of an identification and the damping around which the model is identified."""

    name: str  #: Name of the vehicle.
    rig: tuple[str, ...]  #: Inputs of the rig: roads, aeroloaders or forces and moments on the chassis.
    forces: tuple[str, ...]  #: Shock forces: `force` of each port.
    outputs: tuple[str, ...]  #: Outputs of the model, which include the shock velocities of all ports.
    baseline_damping: Mapping[str, float]  #: Baseline damping C-bar [N.s/m] by port ("lf", ...; "" for a quarter car).
    #: Values of the static state by output, SI, as in `IdentifiedVehicle`.
    static: Mapping[str, float] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)  #: SHA-256 digests of the files, by name.
    #: Means of the first test's channels, SI, if they were removed from the records: of tire forces, to detect tires
    #: that lift off, and of loads, for the travel that they cause.
    means: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for port in self.ports:
            if channel(port, "velocity") not in self.outputs:
                raise ParameterError(
                    f"{self.name}: {channel(port, 'velocity')} must be an output, as a shock law needs it"
                )
            if port not in self.baseline_damping:
                raise ParameterError(f"{self.name}: the port {port!r} has no baseline damping; specify one [N.s/m]")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of the rig, then the shock forces."""
        return self.rig + self.forces

    @property
    def loads(self) -> tuple[str, ...]:
        """Inputs of the rig that load the chassis."""
        return tuple(name for name in self.rig if quantity(name) != "road")

    @property
    def ports(self) -> tuple[str, ...]:
        """Ports in the order of the forces."""
        return tuple(name.removesuffix("force").rstrip(".") for name in self.forces)

    def of(self, *outputs: str) -> Experiment:
        """Return the experiment with the given outputs and the shock velocities only.

        Raises:
            ParameterError: The experiment has no such output.
        """
        unknown = [name for name in outputs if name not in self.outputs]
        if unknown:
            raise ParameterError(f"there is no output {', '.join(unknown)}; the outputs are {', '.join(self.outputs)}")
        kept = {channel(port, "velocity") for port in self.ports} | set(outputs)
        return replace(self, outputs=tuple(name for name in self.outputs if name in kept))


def quantity(name: str) -> str:
    """Return the quantity of a channel: its name without corner or axle."""
    return name.rpartition(".")[2]


def experiment_of(
    names: Iterable[str],
    baseline_damping: Mapping[str, float],
    *,
    name: str = "vehicle",
    sources: Mapping[str, str] | None = None,
) -> Experiment:
    """Return the experiment for records with the given channels: a quarter car, a seven-DOF car or an 8-post rig.

    The baseline damping C-bar is by port [N.s/m].

    Raises:
        ParameterError: The channels do not include the road and the force of each shock.
    """
    available = tuple(names)
    ports = ("",) if "road" in available else CORNERS
    roads, forces = (tuple(channel(port, quantity) for port in ports) for quantity in ("road", "force"))
    aero = tuple(n for n in (channel(port, "aero") for port in ports) if n in available)
    loads = aero or tuple(n for n in _LOADS if n in available)
    if not set(roads + forces) <= set(available):
        missing = ", ".join(sorted(set(roads + forces) - set(available)))
        raise ParameterError(
            f"{name}: the records lack {missing}; a rig test needs the road and the force of each shock"
        )
    outputs = tuple(channel(port, quantity) for quantity in _CORNER_OUTPUTS for port in ports)
    outputs = tuple(n for n in (*outputs, *_CAR_OUTPUTS) if n in available)
    return Experiment(name, roads + loads, forces, outputs, baseline_damping, {}, sources or {})


#: Loads on a chassis without aeroloaders.
_LOADS = ("aero_force", "heave_force", "roll_moment", "pitch_moment")
#: Outputs of Table 6.1 that the model has if the records have them.
_CORNER_OUTPUTS = ("velocity", "displacement", "tire_force", "hub_acceleration", "chassis_acceleration")
_CAR_OUTPUTS = ("ride_height", "front.ride_height", "rear.ride_height", "driver.acceleration")


# ---- Choice of the baseline test, and the linear damping around which a vehicle is identified (6.3.1) ---------------

#: RMS deviation of a shock's force from `c v`, relative to `c v`, above which the shock is reported as nonlinear [1].
_NEAR_LINEAR = 0.3
#: Relative difference in damping from which a shock is another one [1].
OTHER_SHOCK = 0.1


class Baseline(NamedTuple):
    """The baseline test and the damping of its shocks."""

    test: int  #: Index of the baseline test among the records.
    damping: Mapping[str, float]  #: Least-squares slope of force over velocity (C-bar) [N.s/m], by port.
    #: RMS deviation of the shock's force from that line, relative to the line's RMS [1], by port.
    deviations: Mapping[str, float]
    #: Indices of all records: the baseline first, then alternate tests in the order of the ports.
    order: tuple[int, ...]

    def notes(self) -> tuple[str, ...]:
        """Return notes on the baseline for the user."""
        far = [f"{port or 'the port'} ({100.0 * part:.0f} %)" for port, part in self.deviations.items()
               if part > _NEAR_LINEAR]  # fmt: skip
        return (f"baseline shocks deviate from a straight line: {', '.join(far)}",) if far else ()

    def experiment(
        self, prepared: Prepared, *, name: str, damping: float | None = None, outputs: Sequence[str] = ()
    ) -> Experiment:
        """Return the experiment about this baseline, or about a `damping` of all ports [N.s/m].

        Without `outputs` the model has all possible ones.
        """
        rates = {port: slope if damping is None else damping for port, slope in self.damping.items()}
        whole = experiment_of(prepared.channels, rates, name=name, sources=prepared.sources)
        whole = replace(whole, means=prepared.means[self.test])
        return whole.of(*outputs) if outputs else whole


def find_baseline(records: Sequence[TimeSeries], ports: Sequence[str], *, test: int | None = None) -> Baseline:
    """Find the baseline test, if it is not given: at each corner it has the shock that most tests have.

    The records have `force` and `velocity` of every port: "lf", ...; "" for a quarter car.

    Raises:
        InputError: All tests have the same shock at a port, so the effect of its force cannot be separated.
    """
    slopes = np.array([[port_slope(record, port) for port in ports] for record in records])
    usual = np.sort(slopes, axis=0)[len(slopes) // 2]  # with two tests, the larger damping
    chosen = int(np.argmin(np.abs(slopes / usual - 1.0).max(axis=1))) if test is None else test
    changes = np.abs(slopes / slopes[chosen] - 1.0)
    for place, port in enumerate(ports):
        if len(records) > 1 and changes[:, place].max() < OTHER_SHOCK:
            raise InputError(
                f"no test has another shock at {port or 'the port'}: the damping is {slopes[chosen, place]:.0f} N.s/m "
                f"within {100.0 * OTHER_SHOCK:.0f} % in all {len(records)} tests; add a test with about half of it "
                "(6.1.4)"
            )
    damping = dict(zip(ports, slopes[chosen].tolist(), strict=True))
    deviations = {port: _deviation(records[chosen], port, slope) for port, slope in damping.items()}
    others = sorted((k for k in range(len(records)) if k != chosen), key=lambda k: (int(np.argmax(changes[k])), k))
    return Baseline(chosen, damping, deviations, (chosen, *others))


def port_slope(record: TimeSeries, port: str) -> float:
    """Return the slope c of a port's measured force over its measured velocity [N.s/m]."""
    v, force = _motion(record, port)
    return float(v @ force / (v @ v))


def _deviation(record: TimeSeries, port: str, slope: float) -> float:
    """Return the RMS of F - c v relative to that of c v [1]."""
    v, force = _motion(record, port)
    return float(np.std(force - slope * v) / np.std(slope * v))


def _motion(record: TimeSeries, port: str) -> Iterator[Array]:
    return (record[channel(port, name)] - record[channel(port, name)].mean() for name in ("velocity", "force"))


# ==== Ranges that the tests covered, and where another record or a simulation leaves them ============================

#: Largest ratio of a channel's peak to that of the tests; largest share of an output's power above the fit's band,
#: as in a study.
_BEYOND, _ABOVE = 1.1, 0.1

#: Band of the records that fits are made from [Hz]; peaks are compared in it.
_BAND = 50.0

#: Shocks below this fraction of the tests' velocities barely move: friction holds them.
_GENTLE = 0.05

#: Fraction of its mean load at or below which a tire has lifted.
_LIFTED = 0.01

#: Quantities whose ranges a fit stores.
_RANGED = ("velocity", "displacement", "force", "tire_force")


@dataclass(frozen=True, slots=True)
class Ranges:
    """Ranges that the tests covered."""

    frequency: tuple[float, float] | None  #: Lowest and highest frequency of the fit [Hz]; None if it is not known.
    channels: Mapping[str, tuple[float, float]]  #: Smallest and largest value by channel, SI.

    def as_mapping(self) -> dict[str, tuple[float, float]]:
        """Return the ranges by channel and the frequency range, in the form stored in a fit."""
        return {**({} if self.frequency is None else {"frequency": self.frequency}), **self.channels}

    @classmethod
    def of_mapping(cls, ranges: Mapping[str, tuple[float, float]]) -> Ranges:
        """Return the ranges stored in a fit."""
        channels = {name: span for name, span in ranges.items() if name != "frequency"}
        return cls(ranges.get("frequency"), channels)

    def beyond(self, series: TimeSeries) -> tuple[str, ...]:
        """Return up to two sentences on where a series without means leaves the tests' amplitudes and frequencies."""
        sentences = []
        peaks = {name: _peak(series, name) for name in self.channels if name in series and self._covered(name) > 0.0}
        times = {
            name: peak / self._covered(name) for name, peak in peaks.items() if peak > _BEYOND * self._covered(name)
        }
        if times:
            over = sorted(times, key=lambda name: -times[name])
            listed = ", ".join(f"{n} {times[n]:.2g} times ({peaks[n]:.3g} {series.unit(n)})" for n in over)
            sentences.append(f"amplitudes beyond the fit's tests: {listed}")
        if self.frequency is None:
            return tuple(sentences)
        high = self.frequency[1]
        moving = [name for name in series.names if quantity(name) in ("velocity", "tire_force")]
        shares = {name: share for name in moving if (share := _share_above(series, name, high)) > _ABOVE}
        if shares:
            over = sorted(shares, key=lambda name: -shares[name])
            listed = ", ".join(f"{name} {100.0 * shares[name]:.0f} %" for name in over)
            sentences.append(
                f"power above {high:.3g} Hz, where the model was not fitted and no criterion applies: {listed}"
            )
        return tuple(sentences)

    def is_gentle(self, series: TimeSeries) -> bool:
        """Return whether all shocks stay below 5 % of the velocities of the tests; False if that is not known."""
        names = [name for name in self.channels if quantity(name) == "velocity" and name in series]
        return bool(names) and all(_peak(series, name) < _GENTLE * self._covered(name) for name in names)

    def _covered(self, name: str) -> float:
        return max(abs(end) for end in self.channels[name])


def ranges_of(tests: Sequence[TimeSeries], experiment: Experiment, frequency: tuple[float, float]) -> Ranges:
    """Return the ranges that the tests covered."""
    names = [name for name in (*experiment.forces, *experiment.outputs) if quantity(name) in _RANGED]
    low = {name: min(float(test[name].min()) for test in tests) for name in names}
    high = {name: max(float(test[name].max()) for test in tests) for name in names}
    return Ranges(frequency, {name: (low[name], high[name]) for name in names})


def lifted_tires(tests: Sequence[TimeSeries], means: Mapping[str, float]) -> tuple[str, ...]:
    """Return the channels of the tires that leave the ground in tests without means.

    Tire forces with means near zero are changes from rest and cannot show it.
    """
    tires = {n: mean for n, mean in means.items() if quantity(n) == "tire_force" and n in tests[0]}
    return tuple(
        name
        for name, mean in tires.items()
        if mean > tests[0][name].std() and mean + min(float(test[name].min()) for test in tests) <= _LIFTED * mean
    )


def _peak(series: TimeSeries, name: str) -> float:
    rate = series.sample_rate
    return float(np.abs(lowpass(series[name], rate, min(_BAND, 0.4 * rate), order=4)).max())


def _share_above(series: TimeSeries, name: str, high: float) -> float:
    lines = np.fft.rfftfreq(len(series), 1.0 / series.sample_rate)
    power = np.abs(np.fft.rfft(series[name] - series[name].mean())) ** 2
    whole = float(power.sum())
    return float(power[lines > high].sum() / whole) if whole else 0.0


# ==== Frequency band: up to where the inputs of the tests explain their outputs ======================================

#: Share of the outputs that must be supported [1].
_SHARE = 0.75

#: Lowest upper end [Hz]: below it a coherence may be low because an output hardly moves there.
_LOWEST = 6.0

#: Width of the median filter over the coherence, and of the range in which it must stay low [Hz]; a narrower dip does
#: not end the band.
_SMOOTHING, _WIDTH = 1.0, 2.0

#: Number of outputs that a sentence names.
_LISTED = 4


@dataclass(frozen=True, slots=True)
class CoherentBand:
    """Criterion for the upper end of the band that a model is fitted in.

    An output is supported up to the frequency above which its multiple coherence stays below `coherence`. The tests
    support a model up to the frequency where fewer than three quarters of the outputs are supported (the others are
    named), or where a road or a shock force has no power. The band ends `margin` below it, as the response beyond a
    band decides its last poles.

    Raises:
        ParameterError: A value is outside its range.
    """

    coherence: float = 0.9  #: Lowest multiple coherence [1].
    margin: float = 0.15  #: Part of the supported frequencies at their upper end that is not fitted [1].
    highest: float = 30.0  #: Highest frequency that is examined [Hz].

    def __post_init__(self) -> None:
        if not (0.0 < self.coherence < 1.0 and self.highest > _LOWEST):
            raise ParameterError(f"{self}: coherence must be between 0 and 1, highest above {_LOWEST:g} Hz")

    def of(self, response: FrequencyResponse) -> SupportedBand:
        """Return the upper end that a response supports; it reaches up to `highest` if the records allow it."""
        top = min(self.highest, float(response.frequency[-1]))
        powered = _powered(response, top)
        if response.coherence is None:
            return self._end(min(top, powered), {}, powered)
        limits = {n: self._limit(response.frequency, row, top)
                  for n, row in zip(response.output_names, response.coherence, strict=True)}  # fmt: skip
        ordered = sorted(limits.values(), reverse=True)
        coherent = ordered[int(np.ceil(_SHARE * len(ordered))) - 1]
        return self._end(min(coherent, powered, top), limits, powered)

    def _end(self, supported: float, limits: Mapping[str, float], powered: float) -> SupportedBand:
        high = max((1.0 - self.margin) * supported, min(_LOWEST, supported))
        return SupportedBand(high, supported, limits, self.coherence, powered)

    def _limit(self, frequency: Array, coherence: Array, top: float) -> float:
        """Return the frequency [Hz] above which a coherence (K,) stays low."""
        spacing = float(frequency[1] - frequency[0]) if frequency.size > 1 else _WIDTH
        smooth = median_filter(coherence, max(1, round(_SMOOTHING / spacing)), mode="nearest")
        low = (smooth < self.coherence) & (frequency > _LOWEST)
        count = max(1, round(_WIDTH / spacing))
        # Where `count` values from here on, or all that remain, are low.
        ends = np.concatenate((low, np.ones(count - 1, dtype=np.bool_)))
        stays = np.lib.stride_tricks.sliding_window_view(ends, count).all(axis=1)
        return min(top, float(frequency[np.argmax(stays)]) if stays.any() else top)


@dataclass(frozen=True, slots=True)
class SupportedBand:
    """Upper end of the band that rig tests support."""

    high: float  #: Upper end of the band of a fit [Hz].
    supported: float  #: Frequency up to which the tests support a model [Hz].
    outputs: Mapping[str, float]  #: Frequency [Hz] up to which the coherence of each output is sufficient.
    coherence: float  #: Lowest multiple coherence that counts as sufficient [1].
    #: Highest frequency at which all roads and shock forces have power [Hz]; infinite if they have it wherever it was
    #: examined.
    powered: float

    def summary(self) -> str:
        """Return the upper end and its reason as a sentence."""
        text = f"The model was fitted up to {self.high:.3g} Hz, as the tests support one up to {self.supported:.3g} Hz"
        weak = [name for name, limit in self.outputs.items() if limit <= self.supported + 1e-9]
        if self.powered <= self.supported + 1e-9:
            reason = f"{text}; above, a road or a shock force has no power"
        elif weak:
            more = f" and {len(weak) - _LISTED} more" if len(weak) > _LISTED else ""
            listed = ", ".join(weak[:_LISTED]) + more
            reason = f"{text}; above, the multiple coherence of {listed} stays below {self.coherence:g}"
        else:
            reason = f"{text}, the highest frequency that was examined"
        less = {name: limit for name, limit in self.outputs.items() if limit < self.high}
        if not less:
            return f"{reason}."
        exceptions = ", ".join(f"{name} {limit:.3g} Hz" for name, limit in sorted(less.items(), key=lambda p: p[1]))
        return f"{reason}. The coherence of some outputs is sufficient only up to a lower frequency: {exceptions}."


def _powered(response: FrequencyResponse, top: float) -> float:
    """Return the highest frequency [Hz] at which all roads and shock forces have power; infinite if not below `top`."""
    if response.variance is None:
        return np.inf
    needed = [quantity(name) in ("road", "force") for name in response.input_names]
    known = np.asarray(np.isfinite(response.variance[:, needed]).any(axis=0), dtype=np.bool_)
    below = response.frequency <= top
    last = min((float(response.frequency[np.flatnonzero(row)[-1]]) for row in known if row.any()), default=np.inf)
    return last if last < response.frequency[below][-1] else np.inf
