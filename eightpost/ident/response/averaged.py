"""Averaged frequency responses and coherence, and those of tests with the same drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.ident.response.records import Blocks, Record, Records, gather
from eightpost.signals import TimeSeries

# ---- Power of the inputs of records, which determines where a response is important ---------------------------------


def input_power(records: Records, frequency: Array) -> Array:
    """Return the power spectral density of each input, averaged over all tests (m, K) [unit^2/Hz].

    Args:
        records: Tests.
        frequency: Frequencies (K,) [Hz], about evenly spaced; the spacing determines the length of the blocks.
    """
    spacing = float(np.mean(np.diff(frequency))) if frequency.size > 1 else float(frequency[0])
    total = np.zeros((len(records.inputs), frequency.size))
    for test in records.tests:
        size = min(test.u.shape[1], max(16, round(records.rate / spacing)))
        lines, power = welch(test.u, records.rate, nperseg=size)
        total += np.stack([np.interp(frequency, lines, row) for row in power])
    return np.asarray(total / len(records.tests))


# ---- Multiple and partial coherence from a regression ---------------------------------------------------------------


def _multiple_coherence(solved: _Regression) -> Array:
    """Return the fraction of each output's power that all inputs explain (p, K), 1 - |E|^2 / |Y|^2; 0 without power."""
    unexplained = np.divide(solved.residual, solved.total, out=np.ones_like(solved.total), where=solved.total > 0.0)
    return np.asarray(np.clip(1.0 - unexplained, 0.0, 1.0))


def partial_coherence(solved: _Regression) -> Array:
    """Return the coherence of each output and input after removal of the part that the other inputs explain (p, m, K).

    Without input j the residual increases by `|H_ij|^2 / ((U* U)^-1)_jj`. The coherence of the two conditioned signals
    is this increase over the residual without j. It is 0 where the input was dropped.
    """
    spread = np.where(solved.active, solved.spread, np.inf)[None]
    growth = np.abs(solved.H) ** 2 / spread
    without = growth + solved.residual[:, None, :]
    return np.asarray(np.divide(growth, without, out=np.zeros_like(growth), where=without > 0.0))


def _response_variance(solved: _Regression, blocks: int, independent: float) -> Array:
    """Return the variance of H (p, m, K) for noise on the outputs.

    Args:
        solved: Solution of the regression.
        blocks: Number of overlapping blocks R.
        independent: Equivalent number of independent blocks.
    """
    freedom = np.maximum(blocks - solved.active.sum(axis=0), 1)
    noise = solved.residual / freedom * (blocks / independent)
    return np.asarray(noise[:, None, :] * solved.spread[None], dtype=np.float64)


# ---- Estimation of a frequency response from records with any recipe ------------------------------------------------


class Recipe(Protocol):
    """Protocol of the estimators `H1`, `SameDrive` and `LocalPolynomial`."""

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate the response of every output to every input."""
        ...


def estimate_response(
    records: Sequence[TimeSeries],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    recipe: Recipe,
    baseline_damping: Mapping[str, float] | None = None,
) -> FrequencyResponse:
    """Estimate frequency responses.

    Args:
        records: Records, one per test; sequential recipes define their order.
        inputs: Names of the inputs in every record, including shock forces.
        outputs: Names of the outputs in every record.
        recipe: Estimator.
        baseline_damping: C-bar by port [N.s/m]: `c v` is subtracted from the shock forces (Eq 6.4), and the result is
            the response of the vehicle with these dampers. None uses the forces without change.

    Raises:
        InputError: Records, channels and recipe do not match.
    """
    return recipe.estimate(gather(records, inputs, outputs, baseline_damping))


# ---- Scaled linear regression over blocks, for all frequencies at once ----------------------------------------------

#: Condition number of the scaled columns above which the inputs are not independent.
WORST_CONDITION = 1e7


class _Regression(NamedTuple):
    """Solution of `Y = U H^T + E` at every frequency."""

    H: Complex  #: Responses (p, m, K); 0 where an input was dropped.
    spread: Array  #: Diagonal of (U* U)^-1 (m, K); infinite where an input was dropped.
    residual: Array  #: Sum of |E|^2 (p, K).
    total: Array  #: Sum of |Y|^2 (p, K).
    active: NDArray[np.bool_]  #: Mask of the inputs that were kept (m, K).


def regress(U: Complex, Y: Complex, *, power_floor: float, names: Sequence[str]) -> _Regression:
    """Solve for H; inputs are dropped at frequencies where they have no power.

    Args:
        U: Inputs (K, R, m).
        Y: Outputs (K, R, p).
        power_floor: Amplitude of an input, relative to its largest over frequency, below which it is dropped [1].
        names: Names of the inputs, for messages.

    Raises:
        InputError: There are not more blocks than inputs, an input is zero, or inputs depend on each other.
    """
    if U.shape[1] <= U.shape[2]:
        raise InputError(f"{U.shape[1]} blocks are too few for {U.shape[2]} inputs; use shorter blocks or more data")
    size = np.linalg.norm(U, axis=1)
    active = powered(size, power_floor, names)
    scale = np.where(active, size, 1.0)
    left, singular, right = np.linalg.svd(U * (active / scale)[:, None, :], full_matrices=False)
    inverse = _inverted(singular, active, names)
    coordinates = left.conj().transpose(0, 2, 1) @ Y
    V = right.conj().transpose(0, 2, 1) * inverse[:, None, :]
    H = (V @ coordinates) / scale[:, :, None]
    residual = np.sum(np.abs(Y - U @ H) ** 2, axis=1)
    spread = np.where(active, np.sum(np.abs(V) ** 2, axis=2) / scale**2, np.inf)
    total = np.sum(np.abs(Y) ** 2, axis=1)
    return _Regression(np.ascontiguousarray(H.transpose(2, 1, 0)), spread.T, residual.T, total.T, active.T)


def powered(size: Array, power_floor: float, names: Sequence[str]) -> NDArray[np.bool_]:
    """Return the mask of frequencies at which an input has power (K, m), from its amplitudes `size` (K, m).

    Raises:
        InputError: An input is zero in all records.
    """
    largest = size.max(axis=0)
    for name, value in zip(names, largest, strict=True):
        if not value > 0.0:
            raise InputError(f"the input {name!r} is zero in all records; remove it from the inputs")
    return np.asarray(size > power_floor * largest, dtype=np.bool_)


def _inverted(singular: Array, active: NDArray[np.bool_], names: Sequence[str]) -> Array:
    """Invert the singular values (K, m) of the active columns; the zeros of dropped columns remain 0."""
    rank = active.sum(axis=1)
    kept = np.arange(singular.shape[1])[None, :] < rank[:, None]
    smallest = np.min(np.where(kept, singular, np.inf), axis=1, initial=np.inf)
    dependent = (rank > 0) & (smallest * WORST_CONDITION < singular[:, 0])
    if dependent.mean() > 0.5:
        raise InputError(
            f"the inputs {', '.join(names)} depend linearly on each other (condition above {WORST_CONDITION:g} at most "
            "frequencies): with linear shocks the rig's inputs determine the forces (Eq 5.34); add records with "
            "another shock at each corner"
        )
    safe = np.where(kept & (singular * WORST_CONDITION >= singular[:, :1]), singular, np.inf)
    return np.asarray(1.0 / safe, dtype=np.float64)


# ---- Estimator H1, averaged over windowed blocks --------------------------------------------------------------------

#: Amplitude of an input, relative to its largest, below which it has no power and is dropped (-50 dB) [1].
POWER_FLOOR = 3e-3


@dataclass(frozen=True, slots=True)
class H1:
    """Linear regression for noise on the outputs (Eq 4.19, 5.32; the global method of Eq 6.7 for several shocks)."""

    blocks: Blocks  #: Division of the records into blocks.

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate from all records at once."""
        spectra = self.blocks.spectra(records)
        names = [channel.name for channel in records.inputs]
        solved = regress(spectra.U, spectra.Y, power_floor=POWER_FLOOR, names=names)
        return FrequencyResponse(
            spectra.frequency,
            solved.H,
            records.inputs,
            records.outputs,
            _multiple_coherence(solved),
            partial_coherence(solved),
            _response_variance(solved, spectra.U.shape[1], spectra.independent),
        )


# ---- Tests with the same drive --------------------------------------------------------------------------------------

#: Relative difference of two measured drives below which they are the same drive [1].
_SAME_DRIVE = 0.1


@dataclass(frozen=True, slots=True)
class SameDrive:
    """Estimator of Eq 4.24 to 4.26 for tests with one drive file: force differences explain changes of the outputs.

    The records are the baseline and one alternate test per force, in the order of `forces`, with the same drive sample
    by sample. With one force it is the dissertation's two-experiment method for the quarter car.
    """

    recipe: Recipe  #: Estimator of both steps.
    forces: tuple[str, ...]  #: Names of the inputs that are shock-force differences.

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


def _change(records: Records, test: int, rig: Sequence[int], force: int) -> Records:
    """Return the change of the outputs (Eq 4.26) with one force as the input."""
    before, after = records.tests[0], records.tests[test]
    columns = list(rig)
    if before.u.shape != after.u.shape or not _alike(before.u[columns], after.u[columns]):
        raise InputError(f"the drive of record {test + 1} differs from that of the first one; use H1 for all records")
    changed = Record(after.u[[force]] - before.u[[force]], after.y - before.y)
    return Records((changed,), records.rate, (records.inputs[force],), records.outputs)


def _alike(before: Array, after: Array) -> bool:
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


def _column_coherence(part: FrequencyResponse) -> Array:
    """Return the partial coherence (p, m, K), which for a single force is the ordinary coherence."""
    if part.partial_coherence is not None:
        return part.partial_coherence
    if len(part.inputs) == 1 and part.coherence is not None:
        return part.coherence[:, None, :]
    return np.full(part.H.shape, np.nan)
