"""Frequency responses: their files, their treatments, and preconditioning before a model is fitted."""

from __future__ import annotations

import io
import json
import math
import tokenize
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import with_config
from scipy.signal import butter, sosfiltfilt
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from eightpost import __version__
from eightpost.archive import read_archive
from eightpost.array_types import Array, Complex
from eightpost.errors import FileFormatError, FmuError, ParameterError
from eightpost.files import MALFORMED, atomic_path, parse_json
from eightpost.schema import OPEN, document_of
from eightpost.vehicle.statespace import Channel, StateSpace

# ==== Responses and their files ======================================================================================

# ---- Frequency responses between named inputs and outputs -----------------------------------------------------------

#: Arrays that a frequency response may lack.
OPTIONAL = ("coherence", "partial_coherence", "variance")

#: Key outputs: shock velocities, and the outputs that setups are judged by.
KEY_OUTPUTS = ("velocity", "tire_force", "ride_height")


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyResponse:
    """Frequency responses between named channels; arrays are (output, input, frequency), as in python-control.

    The arrays are copied and read-only.
    """

    frequency: Array  #: Increasing frequencies (K,) [Hz].
    H: Complex  #: Responses (p, m, K) in output unit per input unit; 0 where an input had no power.
    inputs: tuple[Channel, ...]  #: Input channels (m).
    outputs: tuple[Channel, ...]  #: Output channels (p).
    #: Multiple coherence (p, K) [1], the fraction of an output's power that all inputs explain; or None.
    coherence: Array | None = None
    #: Coherence of input and output (p, m, K) [1], after removal of the part that the other inputs explain; or None.
    partial_coherence: Array | None = None
    #: Variance of H (p, m, K), `E |H - E H|^2`; infinite where an input had no power; or None.
    variance: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "inputs", tuple(self.inputs))
        object.__setattr__(self, "outputs", tuple(self.outputs))
        frequency = np.asarray(self.frequency, dtype=np.float64)
        if frequency.ndim != 1 or not frequency.size:
            raise ParameterError(f"the frequencies have the shape {frequency.shape}; give a vector with at least one")
        if not np.isfinite(frequency).all() or frequency[0] < 0.0 or (np.diff(frequency) <= 0.0).any():
            raise ParameterError("the frequencies must be finite, not negative, and increasing")
        p, m, count = len(self.outputs), len(self.inputs), frequency.size
        shapes = dict(zip(("frequency", "H", *OPTIONAL), ((count,), (p, m, count), (p, count), *[(p, m, count)] * 2),
                          strict=True))  # fmt: skip
        for name, shape in shapes.items():
            if getattr(self, name) is None:
                continue
            values = np.array(getattr(self, name), dtype=np.complex128 if name == "H" else np.float64, order="C")
            if values.shape != shape:
                raise ParameterError(f"{name} has the shape {values.shape}; channels and frequencies require {shape}")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if not np.isfinite(self.H).all():
            raise ParameterError("a frequency response contains values that are not finite")
        for kind, names in (("inputs", self.input_names), ("outputs", self.output_names)):
            if twice := sorted({name for name in names if names.count(name) > 1}):
                raise ParameterError(f"{kind} contain {', '.join(twice)} more than once; names must be unique")

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return tuple(channel.name for channel in self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return tuple(channel.name for channel in self.outputs)

    def between(self, output: str, input: str) -> Complex:
        """Return the response (K,) of one output to one input."""
        row, column = _position("output", self.output_names, output), _position("input", self.input_names, input)
        path: Complex = self.H[row, column]
        return path

    def with_response(self, H: ArrayLike) -> FrequencyResponse:
        """Return a copy with other values of H (p, m, K); coherence and variance remain those of the estimate."""
        return replace(self, H=np.asarray(H, dtype=np.complex128))

    def select(self, *, inputs: Iterable[str] | None = None, outputs: Iterable[str] | None = None) -> FrequencyResponse:
        """Return the given channels in the given order; None keeps all."""
        columns = _positions("input", self.input_names, inputs)
        rows = _positions("output", self.output_names, outputs)
        paths = np.ix_(rows, columns)
        return FrequencyResponse(
            self.frequency,
            self.H[paths],
            tuple(self.inputs[i] for i in columns),
            tuple(self.outputs[i] for i in rows),
            None if self.coherence is None else self.coherence[rows],
            *(None if values is None else values[paths] for values in (self.partial_coherence, self.variance)),
        )

    def band(self, low: float, high: float) -> FrequencyResponse:
        """Return the response at the frequencies with `low <= frequency <= high` [Hz].

        Raises:
            ParameterError: The response has no such frequency.
        """
        inside = (self.frequency >= low) & (self.frequency <= high)
        if not inside.any():
            span = f"{self.frequency[0]:g} to {self.frequency[-1]:g} Hz"
            raise ParameterError(f"the response has no frequency between {low:g} and {high:g} Hz; it has {span}")
        return self.at(inside)

    def at(self, chosen: slice | NDArray[np.bool_]) -> FrequencyResponse:
        """Return the response at the chosen frequencies: a slice of positions, or whether each (K,) is kept."""
        arrays: dict[str, Any] = {name: values[..., chosen] for name, values in self.arrays().items()}
        return replace(self, **arrays)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the response by name, H (p, m, K) and others, without those that are None."""
        arrays = {name: getattr(self, name) for name in ("frequency", "H", *OPTIONAL)}
        return {name: values for name, values in arrays.items() if values is not None}


def response_of(model: StateSpace, frequency_hz: ArrayLike) -> FrequencyResponse:
    """Return the exact frequency response of a linear model at `frequency_hz` (K,) [Hz]."""
    frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    return FrequencyResponse(frequency, model.frequency_response(frequency), model.inputs, model.outputs)


def contribution_error(estimate: FrequencyResponse, reference: FrequencyResponse, input_power: ArrayLike) -> Array:
    """Return the relative error of each output's response (p,) [1] to inputs of power S (m, K), in any common scale.

        e_i = sqrt( sum_jk |dH_ij(f_k)|^2 S_j(f_k)  /  sum_jk |H_ij(f_k)|^2 S_j(f_k) )

    A path that contributes little to its output has little weight, even if it is wrong.

    Raises:
        ParameterError: The two responses differ in channels or frequencies.
    """
    if estimate.H.shape != reference.H.shape or not np.allclose(estimate.frequency, reference.frequency):
        raise ParameterError("the two responses differ in channels or frequencies; use the same for both")
    S = np.asarray(input_power, dtype=np.float64)
    wrong = np.sum(np.abs(estimate.H - reference.H) ** 2 * S, axis=(1, 2))
    whole = np.sum(np.abs(reference.H) ** 2 * S, axis=(1, 2))
    return np.asarray(np.sqrt(wrong / whole), dtype=np.float64)


def _position(kind: str, names: tuple[str, ...], name: str) -> int:
    if name not in names:
        raise ParameterError(f"unknown {kind} {name!r}; the {kind}s are {', '.join(names)}")
    return names.index(name)


def _positions(kind: str, names: tuple[str, ...], selection: Iterable[str] | None) -> list[int]:
    if selection is None:
        return list(range(len(names)))
    chosen = [selection] if isinstance(selection, str) else list(selection)
    return [_position(kind, names, name) for name in chosen]


# ---- Files of frequency responses -----------------------------------------------------------------------------------

#: Newest schema of these files that can be read; it is also the one that is written.
SCHEMA = 1


def write_response(path: str | Path, response: FrequencyResponse, *, sources: Mapping[str, str] | None = None) -> None:
    """Write a frequency response; an existing file is replaced only when the new one is complete."""
    _check_suffix(Path(path))
    header = {**response_header(response), "sources": dict(sources or {})}
    arrays: dict[str, Any] = response.arrays()
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, header=np.array(json.dumps(header)), **arrays)


@with_config(OPEN)
class _Header(TypedDict):
    """Entries of the header of a frequency response."""

    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]


def response_header(response: FrequencyResponse) -> dict[str, Any]:
    """Return what a file states about a frequency response, apart from its arrays."""
    return {
        "kind": "frequency_response",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "inputs": [{"name": channel.name, "unit": channel.unit} for channel in response.inputs],
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in response.outputs],
    }


def read_response(path: str | Path) -> FrequencyResponse:
    """Read a frequency response; it is bitwise equal to the one that was written.

    Raises:
        FileFormatError: The file does not exist, is not a frequency response, or has a newer schema.
    """
    path = Path(path)
    _check_suffix(path)
    members = _arrays(path)
    if "header" not in members:
        raise FileFormatError("is not a frequency response of eightpost: it has no header", path=path)
    header = parse_json(str(members["header"]), path)
    stated = document_of(_Header, header, path, "frequency_response", SCHEMA, "eightpost identify writes responses")
    try:
        optional = [members.get(name) for name in OPTIONAL]
        return FrequencyResponse(members["frequency"], members["H"], stated["inputs"], stated["outputs"], *optional)
    except MALFORMED as error:
        raise FileFormatError(
            f"does not contain a frequency response in the format of this version ({error})", path=path
        ) from error


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz file by name."""
    try:
        contents = read_archive(path)
    except FmuError as error:
        what = f"is not a frequency response of eightpost ({error.__cause__ or error})"
        raise FileFormatError(what, path=path) from error
    try:
        return {name.removesuffix(".npy"): _array(content) for name, content in contents.items()}
    except _DAMAGE as error:
        raise FileFormatError(f"is not a frequency response of eightpost ({error})", path=path) from error


#: Exceptions that numpy raises for damaged arrays.
_DAMAGE = (ValueError, TypeError, EOFError, SyntaxError, LookupError, OverflowError, MemoryError, RecursionError,
           tokenize.TokenError)  # fmt: skip


def _array(content: bytes) -> NDArray[Any]:
    """Return an array after a check of the size in its header, because numpy allocates memory before it reads."""
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array has another format than 1.0")
    shape, _, kind = np.lib.format.read_array_header_1_0(stream)
    if kind.hasobject or math.prod(shape) * kind.itemsize != len(content) - stream.tell():
        raise ValueError("an array does not have the size in its header, or contains objects")
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() != ".npz":
        raise FileFormatError("the name of a frequency response file must end in .npz", path=path)


# ==== Treatments and preconditioning =================================================================================

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
        order, gain, phase, _ = through_points(frequency, path, self.low, self.high)
        inside = frequency > self.low
        changed = path.copy()
        changed[inside] = gain * np.exp(1j * phase) / frequency[inside] ** order
        return changed


@dataclass(frozen=True, slots=True)
class ZeroPhaseSmoothing:
    """Butterworth low-pass over frequency, forward and backward, on the magnitude in dB and the unwrapped phase."""

    width: float = SMOOTHING_WIDTH  #: Width over frequency below which variations are attenuated [Hz]; 0.6 in 5.3.2.

    def apply(self, frequency: Array, path: Complex) -> Complex:
        """Return the smoothed path (K,); a path with zeros has no magnitude in dB and does not change."""
        steps = np.diff(frequency)
        if frequency.size < 3 or steps.max() > 1.001 * steps.min():
            raise ParameterError("smoothing over frequency needs three or more evenly spaced frequencies")
        spacing = float(steps.mean())
        if self.width <= 2.0 * spacing or not np.abs(path).all():
            return path
        sections = butter(_ORDER, 2.0 * spacing / self.width, output="sos")
        pad = min(frequency.size - 1, int(np.ceil(3.0 * _ORDER * self.width / spacing)))
        decibels = sosfiltfilt(sections, 20.0 * np.log10(np.abs(path)), padlen=pad)
        phase = sosfiltfilt(sections, np.unwrap(np.angle(path)), padlen=pad)
        return np.asarray(10.0 ** (decibels / 20.0) * np.exp(1j * phase), dtype=np.complex128)


def through_points(
    frequency: Array, path: Complex, low: float, high: float
) -> tuple[float, float, float, tuple[float, float]]:
    """Return N, K, the mean phase, and (start, slope) of the phase over frequency, through two control points.

    Raises:
        ParameterError: A control point is outside the frequencies, or the path is zero there.
    """
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


# ---- Preconditioning of an estimate ---------------------------------------------------------------------------------

#: Distance between the control points of a residual fit [Hz], as for the (6, 7 Hz) of 5.3.2.
_POINTS_APART = 1.0
#: Lowest frequency from which a residual fit may replace an estimate [Hz].
_LOWEST_END = 2.0


#: Frequency above which residual fits are not reported [Hz], because the weights of the models end near it.
_NOTABLE_END = 15.0


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

    def apply(self, response: FrequencyResponse) -> tuple[FrequencyResponse, tuple[str, ...]]:
        """Return the preconditioned response, and notes."""
        H, frequency, extrapolated = response.H.copy(), response.frequency, 0
        for i, j in np.ndindex(H.shape[:2]):
            end = self._end(response, i, j)
            if self.width > 0.0 and end > 2:
                H[i, j, :end] = ZeroPhaseSmoothing(self.width).apply(frequency[:end], H[i, j, :end])
            if end < frequency.size:
                H[i, j] = _continued(frequency, H[i, j], end)
                extrapolated += int(frequency[end] < _NOTABLE_END)
        paths = H.shape[0] * H.shape[1]
        note = f"{extrapolated} of {paths} paths are extrapolated by Eq 5.48 where their coherence is low"
        return response.with_response(H), (note,) if extrapolated else ()

    def _end(self, response: FrequencyResponse, i: int, j: int) -> int:
        """Return the bin from which a path is not known."""
        known = np.ones(response.frequency.size, dtype=bool)
        if response.variance is not None:
            known &= np.isfinite(response.variance[i, j])
        last = int(np.flatnonzero(known)[-1]) + 1 if known.any() else 0
        if response.partial_coherence is not None and self.coherence > 0.0:
            last = min(last, _lost(response.partial_coherence[i, j], response.frequency, self.coherence))
        return max(last, int(np.searchsorted(response.frequency, _LOWEST_END)))


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
