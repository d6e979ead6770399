"""Treatments and preconditioning of estimated frequency responses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.ident.response.frequency_response import FrequencyResponse

# ---- Treatments of estimated responses before a model is fitted (5.3.2, 6.3.2) --------------------------------------

#: Width over frequency below which variations are smoothed [Hz] (5.3.2), and order of the filter.
SMOOTHING_WIDTH, _ORDER = 0.6, 4


@dataclass(frozen=True, slots=True)
class HighResidual:
    """Residual fit of Eq 5.48, `H = K exp(i phi) / f^N`, through two points; it replaces all above the lower point.

    The gains at both points give K and N; phi is the mean of their phases. 5.3.2 uses (20, 30 Hz) for inputs and
    outputs of one corner and (6, 7 Hz) for others.
    """

    low: float  #: Lower control point [Hz].
    high: float  #: Upper control point [Hz].

    def apply(self, frequency: Array, path: Complex) -> Complex:
        """Return the path (K,) with its high frequencies replaced."""
        order, gain, phase, _ = _through(frequency, path, self.low, self.high)
        inside = frequency > self.low
        changed = path.copy()
        changed[inside] = gain * np.exp(1j * phase) / frequency[inside] ** order
        return changed


@dataclass(frozen=True, slots=True)
class LowResidual:
    """Residual fit of Eq 5.49, `H = K exp(i (phi + b f)) / f^N`, through two points, for all below the first."""

    low: float  #: Lower control point [Hz], about 1 in 5.3.2; all below it is replaced.
    high: float  #: Upper control point [Hz], about 4.

    def apply(self, frequency: Array, path: Complex) -> Complex:
        """Return the path (K,) with its low frequencies replaced."""
        order, gain, _, (start, slope) = _through(frequency, path, self.low, self.high)
        inside = frequency < self.low
        changed = path.copy()
        phase = start + slope * frequency[inside]
        changed[inside] = gain * np.exp(1j * phase) / frequency[inside] ** order
        return changed


@dataclass(frozen=True, slots=True)
class Zeroed:
    """Treatment that sets a path to zero (Table 6.5)."""

    def apply(self, frequency: Array, path: Complex) -> Complex:
        """Return zeros (K,)."""
        return np.zeros_like(path)


@dataclass(frozen=True, slots=True)
class ZeroPhaseSmoothing:
    """Butterworth low-pass over frequency, forward and backward, on the magnitude in dB and the unwrapped phase."""

    width: float = SMOOTHING_WIDTH  #: Width over frequency below which variations are attenuated [Hz]; 0.6 in 5.3.2.

    def apply(self, frequency: Array, path: Complex) -> Complex:
        """Return the smoothed path (K,); a path with zeros has no magnitude in dB and does not change."""
        spacing = _even_spacing(frequency)
        if self.width <= 2.0 * spacing or not np.abs(path).all():
            return path
        sections = butter(_ORDER, 2.0 * spacing / self.width, output="sos")
        pad = min(frequency.size - 1, int(np.ceil(3.0 * _ORDER * self.width / spacing)))
        decibels = sosfiltfilt(sections, 20.0 * np.log10(np.abs(path)), padlen=pad)
        phase = sosfiltfilt(sections, np.unwrap(np.angle(path)), padlen=pad)
        return np.asarray(10.0 ** (decibels / 20.0) * np.exp(1j * phase), dtype=np.complex128)


Treatment = HighResidual | LowResidual | Zeroed | ZeroPhaseSmoothing


def condition(
    response: FrequencyResponse,
    treatment: Treatment,
    *,
    paths: Iterable[tuple[str, str]] | None = None,
) -> FrequencyResponse:
    """Return the response with a treatment applied to some of its paths.

    Args:
        response: Estimated or treated response.
        treatment: Treatment to apply.
        paths: Pairs (output, input); None takes all paths.

    Raises:
        ParameterError: A path does not exist, or a control point is outside the frequencies.
    """
    H = response.H.copy()
    for i, j in _positions(response, paths):
        H[i, j] = treatment.apply(response.frequency, H[i, j])
    return response.with_response(H)


def feedback_paths(active: NDArray[np.bool_], velocities: Iterable[int]) -> NDArray[np.intp]:
    """Count the feedback paths from a shock to an output through the shock velocities (Eq 6.8).

        sum_k h_ik h_kj over the shock velocities k, where h_ik is the response of output i to the force of shock k

    (In the printed sum k = 9 to 12 are column numbers of Table 6.5 for h_ik and row numbers for h_kj.)

    Args:
        active: Mask of the paths from shock force to output that are not zeroed (p, shocks): last columns of Table 6.5.
        velocities: Rows of the shock velocities, one per shock, in the order of the columns.

    Returns:
        Number of feedback paths (p, shocks), Table 6.6.

    Raises:
        ParameterError: The number of shock velocities is not that of the shock forces.
    """
    rows = list(velocities)
    if len(rows) != active.shape[1]:
        raise ParameterError(f"{len(rows)} shock velocities given for {active.shape[1]} shock forces; give one each")
    paths = active.astype(np.intp)
    return np.asarray(paths @ paths[rows], dtype=np.intp)


def _through(
    frequency: Array, path: Complex, low: float, high: float
) -> tuple[float, float, float, tuple[float, float]]:
    """Return N, K, the mean phase, and (start, slope) of the phase over frequency, through two control points."""
    if not frequency[0] <= low < high <= frequency[-1]:
        span = f"{frequency[0]:g} to {frequency[-1]:g} Hz"
        raise ParameterError(f"control points {low:g} and {high:g} Hz must increase and be within {span}")
    a, b = (int(np.argmin(np.abs(frequency - point))) for point in (low, high))
    if not abs(path[a]) or not abs(path[b]):
        raise ParameterError(f"the path is zero at {low:g} or {high:g} Hz; a residual fit needs gains above zero")
    order = -float(np.log(abs(path[b]) / abs(path[a])) / np.log(frequency[b] / frequency[a]))
    gain = float(abs(path[a]) * frequency[a] ** order)
    phase = np.unwrap(np.angle(path[a : b + 1]))
    slope = float((phase[-1] - phase[0]) / (frequency[b] - frequency[a]))
    start = float(phase[0] - slope * frequency[a])
    return order, gain, float(0.5 * (phase[0] + phase[-1])), (start, slope)


def _even_spacing(frequency: Array) -> float:
    steps = np.diff(frequency)
    if frequency.size < 3 or steps.max() > 1.001 * steps.min():
        raise ParameterError("smoothing over frequency needs three or more evenly spaced frequencies")
    return float(steps.mean())


def _positions(response: FrequencyResponse, paths: Iterable[tuple[str, str]] | None) -> list[tuple[int, int]]:
    if paths is None:
        return [(i, j) for i in range(len(response.outputs)) for j in range(len(response.inputs))]
    found = []
    for output, name in paths:
        if output not in response.output_names or name not in response.input_names:
            raise ParameterError(f"there is no path from {name!r} to {output!r}")
        found.append((response.output_names.index(output), response.input_names.index(name)))
    return found


# ---- Preconditioning of an estimate ---------------------------------------------------------------------------------

#: Distance between the control points of a residual fit [Hz], as for the (6, 7 Hz) of 5.3.2.
_POINTS_APART = 1.0
#: Lowest frequency from which a residual fit may replace an estimate [Hz].
_LOWEST_END = 2.0


#: Frequency above which residual fits are not reported [Hz], because the weights of the models end near it.
_NOTABLE_END = 15.0


class _PreconditionedResponse(NamedTuple):
    """Response that is ready for fits, with notes on its preconditioning."""

    response: FrequencyResponse
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Preconditioning:
    """Settings of the preconditioning of an estimate before models are fitted.

    Above the frequency from which the coherence of input and output stays low, the path is extrapolated by Eq 5.48
    through two points below it. (The aeroloaders have no power above 5 Hz; other paths disappear in the noise.) In
    5.3.2 the points are set manually to 6 and 7 Hz for all paths between corners; here the coherence of each path
    determines them.
    """

    width: float = SMOOTHING_WIDTH  #: Width over frequency below which variations are smoothed [Hz]; 0 does not smooth.
    #: Coherence below which a path is replaced, from the frequency above which it stays there [1]; 0 replaces a path
    #: only where the input has no power.
    coherence: float = 0.5
    zeroed: tuple[tuple[str, str], ...] = ()  #: Paths (output, input) that are set to zero (Table 6.5).

    def apply(self, response: FrequencyResponse) -> _PreconditionedResponse:
        """Return the preconditioned response.

        Raises:
            ParameterError: A path that is to be zeroed does not exist.
        """
        H, extrapolated = response.H.copy(), 0
        for i, j in np.ndindex(H.shape[:2]):
            end = self._end(response, i, j)
            H[i, j, :end] = self._smoothed(response.frequency[:end], H[i, j, :end])
            if end < response.frequency.size:
                H[i, j] = _continued(response.frequency, H[i, j], end)
                extrapolated += int(response.frequency[end] < _NOTABLE_END)
        changed = response.with_response(H)
        if self.zeroed:
            changed = condition(changed, Zeroed(), paths=self.zeroed)
        return _PreconditionedResponse(changed, self._notes(extrapolated, H.shape[0] * H.shape[1]))

    def _end(self, response: FrequencyResponse, i: int, j: int) -> int:
        """Return the bin from which a path is not known."""
        known = np.ones(response.frequency.size, dtype=bool)
        if response.variance is not None:
            known &= np.isfinite(response.variance[i, j])
        last = int(np.flatnonzero(known)[-1]) + 1 if known.any() else 0
        if response.partial_coherence is not None and self.coherence > 0.0:
            last = min(last, _lost(response.partial_coherence[i, j], response.frequency, self.coherence))
        return max(last, int(np.searchsorted(response.frequency, _LOWEST_END)))

    def _smoothed(self, frequency: Array, path: Complex) -> Complex:
        if self.width <= 0.0 or frequency.size < 3:
            return path
        return ZeroPhaseSmoothing(self.width).apply(frequency, path)

    def _notes(self, extrapolated: int, paths: int) -> tuple[str, ...]:
        notes = []
        if extrapolated:
            notes.append(f"{extrapolated} of {paths} paths are extrapolated by Eq 5.48 where their coherence is low")
        if self.zeroed:
            notes.append(f"{len(self.zeroed)} of {paths} paths are zeroed")
        return tuple(notes)


def _lost(coherence: Array, frequency: Array, threshold: float) -> int:
    """Return the bin from which coherence (K,), averaged over a residual fit's width, stays below `threshold`.

    If it never reaches the threshold, its maximum is the threshold.
    """
    half = max(1, round(0.5 * _POINTS_APART / float(np.mean(np.diff(frequency)))))
    level = np.convolve(np.pad(coherence, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")
    last = int(np.flatnonzero(level >= min(threshold, level.max()))[-1]) + 1
    return last if last == coherence.size else max(1, last - half)


def _continued(frequency: Array, path: Complex, end: int) -> Complex:
    """Return the path (K,) extrapolated from bin `end` by Eq 5.48, without an increase of magnitude."""
    high = float(frequency[end - 1])
    low = max(high - _POINTS_APART, float(frequency[0]))
    a, b = int(np.searchsorted(frequency, low)), end - 1
    if not (abs(path[a]) > abs(path[b]) > 0.0):
        changed = path.copy()
        changed[end:] = path[b] * (high / frequency[end:]) ** 2  # roll-off of a free mass
        return changed
    continued = HighResidual(float(frequency[a]), high).apply(frequency, path)
    continued[:end] = path[:end]
    return continued
