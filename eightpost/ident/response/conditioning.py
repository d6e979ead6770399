"""Conditioned frequency responses of correlated inputs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError, ParameterError
from eightpost.ident.response.averaged import POWER_FLOOR, Recipe, regress, response_from
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.ident.response.records import Blocks, Record, Records, Spectra

# ---- Treatments of estimated responses before a model is fitted (5.3.2, 6.3.2) --------------------------------------

#: Width over frequency below which variations are smoothed [Hz] (5.3.2).
SMOOTHING_WIDTH = 0.6


@dataclass(frozen=True, slots=True)
class HighResidual:
    """Residual fit of Eq 5.48, `H = K exp(i phi) / f^N`, through two points; it replaces all above the lower point.

    The gains at both points give K and N; phi is the mean of their phases. 5.3.2 uses (20, 30 Hz) for inputs and
    outputs of one corner and (6, 7 Hz) for others.

    Attributes:
        low: Lower control point [Hz].
        high: Upper control point [Hz].
    """

    low: float
    high: float

    def apply(self, frequency: Array, path: Complex) -> Complex:
        """Return the path (K,) with its high frequencies replaced."""
        order, gain, phase, _ = _through(frequency, path, self.low, self.high)
        inside = frequency > self.low
        changed = path.copy()
        changed[inside] = gain * np.exp(1j * phase) / frequency[inside] ** order
        return changed


@dataclass(frozen=True, slots=True)
class LowResidual:
    """Residual fit of Eq 5.49, `H = K exp(i (phi + b f)) / f^N`, through two points; it replaces all below the first.

    Attributes:
        low: Lower control point [Hz], about 1 in 5.3.2; all below it is replaced.
        high: Upper control point [Hz], about 4.
    """

    low: float
    high: float

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
    """Butterworth low-pass over frequency, forward and backward, on the magnitude in dB and the unwrapped phase.

    Attributes:
        width: Width over frequency below which variations are attenuated [Hz]; 0.6 in 5.3.2.
        order: Order of the filter, which is run forward and backward.
    """

    width: float = SMOOTHING_WIDTH
    order: int = 4

    def apply(self, frequency: Array, path: Complex) -> Complex:
        """Return the smoothed path (K,); a path with zeros has no magnitude in dB and does not change."""
        spacing = _even_spacing(frequency)
        if self.width <= 2.0 * spacing or not np.abs(path).all():
            return path
        sections = butter(self.order, 2.0 * spacing / self.width, output="sos")
        pad = min(frequency.size - 1, int(np.ceil(3.0 * self.order * self.width / spacing)))
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


def zeroed_paths(response: FrequencyResponse) -> NDArray[np.bool_]:
    """Return the mask of paths (p, m) that are zero at all frequencies."""
    return np.asarray(~np.abs(response.H).any(axis=2))


def feedback_paths(active: NDArray[np.bool_], velocities: Iterable[int]) -> NDArray[np.intp]:
    """Count the feedback paths from a shock to an output through the shock velocities (Eq 6.8).

        sum_k h_ik h_kj over the shock velocities k, where h_ik is the response of output i to the force of shock k

    (In the printed sum k = 9 to 12 are column numbers of Table 6.5 for h_ik and row numbers for h_kj.)

    Args:
        active: Mask of the paths from shock force to output that are not zeroed (p, shocks): last columns of Table 6.5.
        velocities: Rows of the shock velocities, one per shock, in the order of the columns.

    Returns:
        Number of feedback paths (p, shocks), Table 6.6.
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


# ---- Sequential estimators ------------------------------------------------------------------------------------------

#: Relative difference of two measured drives below which they are the same drive [1].
_SAME_DRIVE = 0.1


@dataclass(frozen=True, slots=True)
class Sequential:
    """Estimator of Eq 5.42 to 5.45 with H1: first the baseline, then the part of the rest that each force explains.

    The records are the baseline and one alternate test per force, in the order of `forces`. The baseline's shocks must
    be linear (with force differences of zero); nonlinear forces cause errors that are not detected. The global H1 does
    not need linear shocks.

    Attributes:
        blocks: Division of the records into blocks.
        forces: Names of the inputs that are shock-force differences.
        power_floor: Relative amplitude below which an input is dropped [1]; see `H1`.
    """

    blocks: Blocks
    forces: tuple[str, ...]
    power_floor: float = POWER_FLOOR

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate the responses to the rig's inputs from the first record, and to each force from its own record."""
        rig, forces = _split(records, self.forces)
        baseline = self._rig(records.only([0], rig))
        parts = [baseline]
        for test, force in enumerate(forces, start=1):
            spectra = self.blocks.spectra(records.only([test], [*rig, force]))
            rest = _unexplained(spectra, baseline.H)
            alone = records.only([test], [force])
            parts.append(self._solve(alone, Spectra(spectra.frequency, spectra.U[..., -1:], rest, *spectra[3:])))
        return _joined(records, parts)

    def _rig(self, records: Records) -> FrequencyResponse:
        return self._solve(records, self.blocks.spectra(records))

    def _solve(self, records: Records, spectra: Spectra) -> FrequencyResponse:
        names = [channel.name for channel in records.inputs]
        solved = regress(spectra.U, spectra.Y, power_floor=self.power_floor, names=names)
        return response_from(records, spectra, solved, solved.H)


@dataclass(frozen=True, slots=True)
class SameDrive:
    """Estimator of Eq 4.24 to 4.26 for tests with one drive file: force differences explain changes of the outputs.

    The records are the baseline and one alternate test per force, in the order of `forces`, with the same drive sample
    by sample. With one force it is the dissertation's two-experiment method for the quarter car.

    Attributes:
        recipe: Estimator of both steps.
        forces: Names of the inputs that are shock-force differences.
    """

    recipe: Recipe
    forces: tuple[str, ...]

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate the responses to the rig's inputs from the first record, and to each force from its own record."""
        rig, forces = _split(records, self.forces)
        parts = [self.recipe.estimate(records.only([0], rig))]
        for test, force in enumerate(forces, start=1):
            parts.append(self.recipe.estimate(_change(records, test, rig, force)))
        return _joined(records, parts)


def _split(records: Records, forces: Sequence[str]) -> tuple[list[int], list[int]]:
    """Return the positions of the rig's inputs and of the forces."""
    names = [channel.name for channel in records.inputs]
    for force in forces:
        if force not in names:
            raise InputError(f"the force {force!r} is not an input; the inputs are {', '.join(names)}")
    if len(records.tests) != 1 + len(forces):
        raise InputError(
            f"{len(records.tests)} records given, but {len(forces)} forces need {1 + len(forces)}: the baseline and "
            "one alternate test per force, in the order of the forces"
        )
    columns = [names.index(force) for force in forces]
    for test, force in enumerate(forces, start=1):
        sizes = [float(np.abs(records.tests[test].u[j]).max()) for j in columns]
        if sizes[test - 1] < max(sizes):
            other = forces[int(np.argmax(sizes))]
            what = f"record {test + 1} changes {other} more than {force}; give the alternate tests in order"
            raise InputError(what)
    return [j for j in range(len(names)) if j not in columns], columns


def _unexplained(spectra: Spectra, H: Complex) -> Complex:
    """Return the part of the outputs that the rig's inputs do not explain (K, R, p), Eq 5.44."""
    explained = spectra.U[..., :-1] @ H.transpose(2, 1, 0)
    return np.asarray(spectra.Y - explained, dtype=np.complex128)


def _change(records: Records, test: int, rig: Sequence[int], force: int) -> Records:
    """Return the change of the outputs (Eq 4.26) with one force as the input."""
    before, after = records.tests[0], records.tests[test]
    columns = list(rig)
    if before.u.shape != after.u.shape or not _alike(before.u[columns], after.u[columns]):
        raise InputError(f"the drive of record {test + 1} differs from that of the first one; use Sequential")
    changed = Record(after.u[[force]] - before.u[[force]], after.y - before.y)
    return Records((changed,), records.rate, (records.inputs[force],), records.outputs)


def _alike(before: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    """Return whether two drives (m, N) differ by no more than sensor errors."""
    return bool((np.std(after - before, axis=1) <= _SAME_DRIVE * np.std(before, axis=1)).all())


def _joined(records: Records, parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return one response with the columns of all parts, in the order of the records' inputs."""
    names = [name for part in parts for name in part.input_names]
    order = [names.index(channel.name) for channel in records.inputs]
    partial = [_column_coherence(part) for part in parts]
    variance = [part.variance for part in parts if part.variance is not None]
    return FrequencyResponse(
        parts[0].frequency,
        np.concatenate([part.H for part in parts], axis=1)[:, order],
        records.inputs,
        records.outputs,
        parts[0].coherence,
        np.concatenate(partial, axis=1)[:, order],
        np.concatenate(variance, axis=1)[:, order] if len(variance) == len(parts) else None,
    )


def _column_coherence(part: FrequencyResponse) -> NDArray[np.float64]:
    """Return the partial coherence (p, m, K), which for a single force is the ordinary coherence."""
    if part.partial_coherence is not None:
        return part.partial_coherence
    if len(part.inputs) == 1 and part.coherence is not None:
        return part.coherence[:, None, :]
    return np.full(part.H.shape, np.nan)


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

    Attributes:
        width: Width over frequency below which variations are smoothed [Hz]; 0 does not smooth.
        coherence: Coherence below which a path is replaced, from the frequency above which it stays there [1]; 0
            replaces a path only where the input has no power.
        zeroed: Paths (output, input) that are set to zero (Table 6.5).
    """

    width: float = SMOOTHING_WIDTH
    coherence: float = 0.5
    zeroed: tuple[tuple[str, str], ...] = ()

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
