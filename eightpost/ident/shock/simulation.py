"""Laws and lags over whole records: simulation, the exact recursion of a lag, the rows that a fit compares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError
from eightpost.extras import needs
from eightpost.ident.shock.curve import curve_forces
from eightpost.shock import Shock, ShockLaw, fit_form, law_module, own_values
from eightpost.shock.law import MOST_PIECES, STRAIGHT
from eightpost.signals import TimeSeries
from eightpost.signals.filters import recursion

if TYPE_CHECKING:
    from eightpost.rig import DynoTest

    #: A record, or samples (N,) of the velocity [m/s], or (N, 2) of velocity and displacement [m].
    Motion = TimeSeries | DynoTest | Array

# ---- The exact first-order lag of whole records ---------------------------------------------------------------------


def lag(static: Array, time_constant: float, step: float) -> Array:
    """Return F_lag of tau dF_lag/dt = F_s - F_lag (Eq 3.24), exact for F_s linear between the samples.

        F_lag[n+1] = (1 - r) F_lag[n] + (r - w) F_s[n] + w F_s[n+1],   r = 1 - exp(-h / tau),  w = 1 - r tau / h

    It starts in equilibrium, F_lag[0] = F_s[0], and is linear in F_s, so each column of a design may be lagged alone.

    Args:
        static: Static force F_s (N,) [N], or columns (N, n).
        time_constant: tau [s], positive.
        step: h [s], positive.

    Returns:
        Lagged values with the shape of `static`.
    """
    rise, weight = _weights(time_constant, step)
    # Filtering along the last axis is several times as fast for contiguous columns.
    series = static.T
    driven = weight * series
    driven[..., 1:] += (rise - weight) * series[..., :-1]
    driven[..., 0] = series[..., 0]
    return recursion(driven, [rise - 1.0]).T


def _lag_response(frequency: Array, time_constant: float, step: float) -> NDArray[np.complex128]:
    """Return the gain (K,) of `lag` at frequencies (K,) [Hz], that is, of the recursion and not the continuous lag."""
    rise, weight = _weights(time_constant, step)
    delay = np.exp(-2j * np.pi * frequency * step)
    return np.asarray((weight + (rise - weight) * delay) / (1.0 + (rise - 1.0) * delay), dtype=np.complex128)


def lag_sensitivity(static: Array, lagged: Array, time_constant: float, step: float) -> Array:
    """Return dF_lag/dtau (N,) [N/s], by differentiating the recursion of `lag`."""
    ratio = step / time_constant
    rise, _ = _weights(time_constant, step)
    ratio_slope = -ratio / time_constant
    rise_slope = np.exp(-ratio) * ratio_slope
    weight_slope = (rise / ratio - np.exp(-ratio)) / ratio * ratio_slope
    drive = np.zeros_like(static)
    drive[1:] = weight_slope * np.diff(static) + rise_slope * (static[:-1] - lagged[:-1])
    return recursion(drive, [rise - 1.0])


def _weights(time_constant: float, step: float) -> tuple[float, float]:
    ratio = step / time_constant
    rise = float(-np.expm1(-ratio))
    return rise, 1.0 - rise / ratio


# ---- The low-pass in the frequency domain, evaluated only at the samples that the optimiser uses --------------------

#: Samples per period of the cutoff frequency; the low-pass leaves 1e-5 at twice the cutoff frequency.
_SAMPLES_PER_PERIOD = 4.0

#: Order of the record's low-pass, and its extension at either end times the cutoff frequency: its slowest pole decays
#: by exp(-2 pi 0.195 f_c t), to 4e-7 here.
_ORDER, _EXTENSION = 8, 12.0


@dataclass(frozen=True, slots=True)
class RowFilter:
    """Filter from N samples to the R rows of a fit: zero-phase low-pass, thinned, inside the segment."""

    count: int  #: Number N of samples.
    rate: float  #: Sampling rate [Hz].
    cutoff: float  #: Cutoff frequency of the low-pass [Hz].
    first: int  #: First sample inside the segment.
    inside: int  #: Number of samples inside the segment.
    every: int  #: Number of samples per row.

    @classmethod
    def of(cls, inside: NDArray[np.bool_], rate: float, cutoff: float) -> RowFilter:
        """Return the filter of a record whose samples (N,) count where `inside` is true."""
        numbers = np.flatnonzero(inside)
        every = max(int(rate // (_SAMPLES_PER_PERIOD * cutoff)), 1)
        return cls(inside.size, rate, cutoff, int(numbers[0]), int(numbers.size), every)

    @property
    def rows(self) -> NDArray[np.intp]:
        """The indices (R,) of the samples that become rows."""
        return np.arange(self.first, self.first + self.inside, self.every)

    @property
    def row_rate(self) -> float:
        """Rows per second [Hz]."""
        return self.rate / self.every

    def spectrum(self, values: Array) -> Complex:
        """Return the spectrum (..., K) of values (..., N) in the passband of the low-pass."""
        left, right, short = self._lengths()
        return np.asarray(rfft(_extended(values, left, right), axis=-1)[..., : short // 2 + 1])

    def rows_of(self, spectrum: Complex, *, time_constant: float | None = None) -> Array:
        """Return the rows (..., R) of a spectrum (..., K), behind a lag if a time constant [s] is given."""
        left, _, short = self._lengths()
        gain: Array | Complex = _gain(self.rate, self.cutoff, short, self.every)
        if time_constant is not None:
            frequency = np.asarray(np.arange(short // 2 + 1) * (self.row_rate / short), dtype=np.float64)
            gain = gain * _lag_response(frequency, time_constant, 1.0 / self.rate)
        start = (self.first + left) // self.every
        samples = irfft(spectrum * gain, short, axis=-1)
        return np.asarray(samples[..., start : start + self.rows.size])

    def __call__(self, values: Array) -> Array:
        """Return the rows (..., R) of values (..., N)."""
        return self.rows_of(self.spectrum(values))

    def _lengths(self) -> tuple[int, int, int]:
        """Return the numbers of samples added before and after, and the number of samples after thinning."""
        extension = int(np.ceil(_EXTENSION * self.rate / self.cutoff))
        left = extension + (-(self.first + extension)) % self.every
        short = int(next_fast_len(-(-(left + self.count + extension) // self.every), True))
        return left, short * self.every - left - self.count, short


@lru_cache(maxsize=64)
def _gain(rate: float, cutoff: float, short: int, every: int) -> Array:
    """Return the low-pass's gain at the remaining frequencies, over the thinning factor."""
    # 1 / (1 + (f / cutoff)^16) after the bilinear transform; the tangent of a frequency is infinite at half the rate.
    angle, corner = np.pi * np.arange(short // 2 + 1) / (short * every), np.tan(np.pi * cutoff / rate)
    passed, stopped = np.cos(angle) ** (2 * _ORDER), (np.sin(angle) / corner) ** (2 * _ORDER)
    return np.asarray(passed / (every * (passed + stopped)))


def _extended(values: Array, left: int, right: int) -> Array:
    """Return values (..., N) extended by point reflection at their ends, as `lowpass` does; constant beyond that."""
    count = values.shape[-1]
    extended = np.empty((*values.shape[:-1], left + count + right))
    extended[..., left : left + count] = values
    a, b = min(left, count - 1), min(right, count - 1)
    extended[..., left - a : left] = 2.0 * values[..., :1] - values[..., a:0:-1]
    extended[..., : left - a] = extended[..., left - a : left - a + 1]
    extended[..., left + count : left + count + b] = 2.0 * values[..., -1:] - values[..., -2 : -2 - b : -1]
    extended[..., left + count + b :] = extended[..., left + count + b - 1 : left + count + b]
    return extended


def simulate(law: ShockLaw, series: TimeSeries) -> Array:
    """Return the port force (N,) [N], positive in compression, of a law driven by a record.

    The velocity changes linearly between the samples, the static force in the straight pieces of `ShockLaw.follow`, as
    in the FMU, and the lag starts in equilibrium, F_lag = F_s.

    Args:
        law: Law with its port.
        series: `velocity` [m/s] at the port; `displacement` [m] from the gas spring's reference, 0 if missing.

    Raises:
        MissingChannelError: The record has no velocity.
    """
    port = law.port
    velocity = port.motion_ratio * series["velocity"]
    displacement = series["displacement"] if "displacement" in series else np.zeros(len(series))
    valve = _valve_forces(law, velocity, series)
    seal = port.seal_friction * np.tanh(velocity / port.friction_velocity)
    gas = port.gas_preload + port.gas_stiffness * port.motion_ratio * displacement
    return np.asarray(port.motion_ratio * (valve + seal + gas), dtype=np.float64)


def _static_forces(law: ShockLaw, velocity: Array) -> Array:
    """Return F_s (N,) [N] at damper velocities (N,) [m/s]."""
    scales = np.where(velocity > 0.0, law.port.compression_scale, law.port.rebound_scale)
    return np.asarray(scales * curve_forces(law.curve, velocity))


def _valve_forces(law: ShockLaw, velocity: Array, series: TimeSeries) -> Array:
    """Return alpha F_lag + (1 - alpha) F_s (N,) [N] over damper velocity (N,) [m/s]."""
    form = fit_form(type(law))
    if form == "no lag" or len(series) < 2:
        return _static_forces(law, velocity)
    step = np.full(len(series) - 1, 1.0 / series.sample_rate) if series.is_uniform else np.diff(series.time)
    pieces = Pieces.of(series["velocity"], step, law.port.motion_ratio)
    if form not in ("lag", "fading lag"):
        return _stepped(law, pieces)
    static, own = _static_forces(law, velocity), own_values(law)
    weight: Array | float = array_form(law_module(type(law)).weight_core)(static, own)
    return weight * _lagged(law, own[0], static[0], pieces) + (1.0 - weight) * static


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Intervals between samples, divided into pieces in which F_s is linear: `ShockLaw.follow` for a whole record."""

    velocity: Array  #: Damper velocity (M+1,) at the ends of the pieces [m/s], preceded by that of the first sample.
    step: Array  #: Duration (M,) of each piece [s].
    first: NDArray[np.int64]  #: Index (N-1,) of the first piece after each sample.
    left: Array  #: Time (M,) from the end of each piece to the next sample [s].
    between: Array  #: Time (N-1,) from sample to sample [s].

    @staticmethod
    def of(velocity: Array, step: Array, motion_ratio: float) -> Pieces:
        """Divide the intervals of steps (N-1,) [s] between port velocities (N,) [m/s]."""
        count = np.minimum(np.floor(np.abs(motion_ratio * np.diff(velocity)) / STRAIGHT) + 1.0, MOST_PIECES)
        whole = count.astype(np.int64)
        first = np.concatenate([[0], np.cumsum(whole)[:-1]])
        sample = np.repeat(np.arange(len(step)), whole)
        share = (np.arange(len(sample)) - first[sample] + 1) / count[sample]
        start, end = velocity[:-1][sample], velocity[1:][sample]
        ends = np.where(share == 1.0, end, start + (end - start) * share)
        joined = motion_ratio * np.concatenate([velocity[:1], ends])
        return Pieces(joined, (step / count)[sample], first, step[sample] * (1.0 - share), step)

    def at_samples(self, values: Array) -> Array:
        """Return the values at the samples (N,), given values (M+1,) at the ends of the pieces."""
        return np.concatenate([values[self.first], values[-1:]])


def _lagged(law: ShockLaw, time_constant: float, begin: float, pieces: Pieces) -> Array:
    """Return F_lag (N,) [N], as `eightpost.shock.law.advance` computes it, for all pieces at once."""
    static = _static_forces(law, pieces.velocity)
    ratio = pieces.step / time_constant
    rise = -np.expm1(-ratio)
    gained = static[:-1] * rise + np.diff(static) * (1.0 - rise / ratio)
    gained = np.add.reduceat(gained * np.exp(-pieces.left / time_constant), pieces.first)
    kept = np.exp(-pieces.between / time_constant)
    if np.all(kept == kept[0]):
        return recursion(np.concatenate([[begin], gained]), [-kept[0]])
    lagged = [begin]
    for share, more in zip(kept.tolist(), gained.tolist(), strict=True):
        lagged.append(share * lagged[-1] + more)
    return np.array(lagged)


@cache
def array_form(core: FunctionType) -> Callable[..., Any]:
    """Return a function of a law's file for static forces (N,): its own code with the functions of numpy."""
    functions = {"min": np.minimum, "max": np.maximum, "copysign": np.copysign}
    return FunctionType(core.__code__, core.__globals__ | functions)


def _stepped(law: ShockLaw, pieces: Pieces) -> Array:
    """Return the valve force (N,) [N] of any law from its own compiled functions."""
    with needs("fit", "fitting a law with dynamics"):
        from eightpost.shock.records import stepped_force  # noqa: PLC0415 - LLVM, which other laws do not need

    valve = law.valve._replace(curve=law.curve.numbers())
    return pieces.at_samples(stepped_force(type(law), valve, own_values(law), pieces.velocity, pieces.step))


# ---- The force that a dynamometer would measure, predicted by a fitted shock, and its score -------------------------


def reference_of(shock: Shock, otherwise: float) -> float:
    """Return the reference displacement of a shock's gas force [m], or `otherwise` if the file does not state it."""
    return float(shock.conditions.get("displacement_reference [m]", otherwise))


def as_measured(shock: Shock) -> ShockLaw:
    """Return the law as measured on a dynamometer: the damper itself, with its gas force."""
    gas = {}
    if shock.conditions.get("gas_treatment") == "included":
        gas = {name: shock.conditions[f"{name}_estimate [{unit}]"]
               for name, unit in (("gas_preload", "N"), ("gas_stiffness", "N/m"))}  # fmt: skip
    return replace(shock.law, port=replace(shock.law.port, motion_ratio=1.0, **gas))


def predicted_force(shock: Shock, motion: Motion, step: float | None) -> Array:
    """Return the predicted force (N,) [N]; see `ShockFit.predict`."""
    series = _series(motion, step)
    if "displacement" in series:
        moved = series["displacement"] - reference_of(shock, float(series["displacement"].mean()))
        series = series.with_channel("displacement", "m", moved)
    return simulate(as_measured(shock), series)


def r_squared(shock: Shock, motion: Motion, force: Array | None, step: float | None) -> float:
    """Return the coefficient of determination of the predicted force; see `ShockFit.score`."""
    measured = _series(motion, step)["force"] if force is None else np.asarray(force, dtype=np.float64)
    predicted = predicted_force(shock, motion, step)
    if measured.shape != predicted.shape:
        raise InputError(f"the force has the shape {measured.shape}, and the motion {predicted.shape}; give as many")
    return float(1.0 - np.sum((measured - predicted) ** 2) / np.sum((measured - measured.mean()) ** 2))


def _series(motion: Motion, step: float | None) -> TimeSeries:
    """Return the record of a motion."""
    series = motion if isinstance(motion, TimeSeries) else getattr(motion, "series", None)
    if isinstance(series, TimeSeries):
        return series
    columns = np.asarray(motion, dtype=np.float64)
    columns = columns[:, None] if columns.ndim == 1 else columns
    if columns.ndim != 2 or columns.shape[1] > 2:
        raise InputError(f"an array of the shape {columns.shape}; give velocities (N,), or (N, 2) with displacements")
    if step is None:
        raise InputError("an array has no times; give the step between its samples in seconds: step=0.001")
    named = zip((("velocity", "m/s"), ("displacement", "m")), columns.T, strict=False)
    channels = {name: (unit, values) for (name, unit), values in named}
    return TimeSeries.from_channels(step * np.arange(len(columns)), channels)
