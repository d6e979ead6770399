"""Estimators of frequency responses: averaged, with local polynomials; bias from noise of the inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.signal import stft, welch

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident.vehicle.experiment import Blocks, Record, Records, gather
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.progress import parts
from eightpost.signals import TimeSeries

# ==== Averaged responses and coherence, and those of tests with the same drive =======================================

# ---- Power of the inputs of records, which determines where a response is important ---------------------------------


def input_power(records: Records, frequency: Array) -> Array:
    """Return the power spectral density of each input (m, K) [unit^2/Hz], averaged over all tests.

    The spacing of the frequencies (K,) [Hz], about even, determines the length of the blocks.
    """
    spacing = float(np.mean(np.diff(frequency))) if frequency.size > 1 else float(frequency[0])
    total = np.zeros((len(records.inputs), frequency.size))
    for test in records.tests:
        size = min(test.u.shape[1], max(16, round(records.rate / spacing)))
        lines, power = welch(test.u, records.rate, nperseg=size)
        total += np.stack([np.interp(frequency, lines, row) for row in power])
    return np.asarray(total / len(records.tests))


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
    """Estimate frequency responses; sequential recipes define the order of the records.

    `c v` with the baseline damping C-bar by port [N.s/m] is subtracted from the shock forces (Eq 6.4): the result is
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

    def coherence(self) -> Array:
        """Return the fraction of each output's power that all inputs explain (p, K), 1 - |E|^2 / |Y|^2."""
        unexplained = np.divide(self.residual, self.total, out=np.ones_like(self.total), where=self.total > 0.0)
        return np.asarray(np.clip(1.0 - unexplained, 0.0, 1.0))

    def partial_coherence(self) -> Array:
        """Return the coherence of output and input without the part that the other inputs explain (p, m, K).

        Without input j the residual increases by `|H_ij|^2 / ((U* U)^-1)_jj`. The coherence of the two conditioned
        signals is this increase over the residual without j. It is 0 where the input was dropped.
        """
        growth = np.abs(self.H) ** 2 / np.where(self.active, self.spread, np.inf)[None]
        without = growth + self.residual[:, None, :]
        return np.asarray(np.divide(growth, without, out=np.zeros_like(growth), where=without > 0.0))

    def variance(self, blocks: int, independent: float) -> Array:
        """Return the variance of H (p, m, K) for noise on the outputs, from overlapping blocks."""
        freedom = np.maximum(blocks - self.active.sum(axis=0), 1)
        noise = self.residual / freedom * (blocks / independent)
        return np.asarray(noise[:, None, :] * self.spread[None], dtype=np.float64)


def regress(U: Complex, Y: Complex, *, power_floor: float, names: Sequence[str]) -> _Regression:
    """Solve for H from inputs U (K, R, m) and outputs Y (K, R, p).

    An input is dropped at frequencies where its amplitude is below `power_floor` times its largest [1].

    Raises:
        InputError: There are not more blocks than inputs, an input is zero, or inputs depend on each other.
    """
    if U.shape[1] <= U.shape[2]:
        raise InputError(f"{U.shape[1]} blocks are too few for {U.shape[2]} inputs; use shorter blocks or more data")
    size = np.linalg.norm(U, axis=1)
    active = powered(size, power_floor, names)
    scale = np.where(active, size, 1.0)
    left, singular, right = np.linalg.svd(U * (active / scale)[:, None, :], full_matrices=False)
    # Singular values of dropped columns are zero and remain 0.
    is_of_column = np.arange(singular.shape[1])[None, :] < active.sum(axis=1)[:, None]
    smallest = np.min(np.where(is_of_column, singular, np.inf), axis=1, initial=np.inf)
    dependent = active.any(axis=1) & (smallest * WORST_CONDITION < singular[:, 0])
    if dependent.mean() > 0.5:
        raise InputError(
            f"the inputs {', '.join(names)} depend linearly on each other (condition above {WORST_CONDITION:g} at most "
            "frequencies): with linear shocks the rig's inputs determine the forces (Eq 5.34); add records with "
            "another shock at each corner"
        )
    is_usable = is_of_column & (singular * WORST_CONDITION >= singular[:, :1])
    inverse = 1.0 / np.where(is_usable, singular, np.inf)
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
            solved.coherence(),
            solved.partial_coherence(),
            solved.variance(spectra.U.shape[1], spectra.independent),
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
        first, columns = records.tests[0], self._columns(records)
        rig = [j for j in range(len(records.inputs)) if j not in columns]
        alone = Record(first.u[rig], first.y)
        estimates = [self._estimated(records, alone, rig)]
        for number, (column, test) in enumerate(zip(columns, records.tests[1:], strict=True), start=2):
            same_drive = first.u.shape == test.u.shape and bool(
                (np.std(test.u[rig] - first.u[rig], axis=1) <= _SAME_DRIVE * np.std(first.u[rig], axis=1)).all()
            )
            if not same_drive:
                raise InputError(
                    f"the drive of record {number} differs from that of the first one; use H1 for all records"
                )
            change = Record(test.u[[column]] - first.u[[column]], test.y - first.y)  # Eq 4.26
            estimates.append(self._estimated(records, change, [column]))
        order = np.argsort([*rig, *columns])
        partial, variance = [_column_coherence(one) for one in estimates], [one.variance for one in estimates]
        known = [values for values in variance if values is not None]
        return FrequencyResponse(
            estimates[0].frequency,
            np.concatenate([one.H for one in estimates], axis=1)[:, order],
            records.inputs,
            records.outputs,
            estimates[0].coherence,
            np.concatenate(partial, axis=1)[:, order],
            np.concatenate(known, axis=1)[:, order] if len(known) == len(estimates) else None,
        )

    def _estimated(self, records: Records, test: Record, columns: Sequence[int]) -> FrequencyResponse:
        inputs = tuple(records.inputs[j] for j in columns)
        return self.recipe.estimate(Records((test,), records.rate, inputs, records.outputs))

    def _columns(self, records: Records) -> list[int]:
        """Return the positions of the forces."""
        names, forces = [channel.name for channel in records.inputs], self.forces
        for force in forces:
            if force not in names:
                raise InputError(f"the force {force!r} is not an input; the inputs are {', '.join(names)}")
        if len(records.tests) != 1 + len(forces):
            raise InputError(
                f"{len(records.tests)} records given, but {len(forces)} forces need {1 + len(forces)}: the baseline "
                "and one alternate test per force, in the order of the forces"
            )
        columns = [names.index(force) for force in forces]
        for number, force in enumerate(forces, start=1):
            sizes = [float(np.abs(records.tests[number].u[j]).max()) for j in columns]
            if sizes[number - 1] < max(sizes):
                other = forces[int(np.argmax(sizes))]
                what = f"record {number + 1} changes {other} more than {force}; give the alternate tests in order"
                raise InputError(what)
        return columns


def _column_coherence(part: FrequencyResponse) -> Array:
    """Return the partial coherence (p, m, K), which for a single force is the ordinary coherence."""
    if part.partial_coherence is not None:
        return part.partial_coherence
    if len(part.inputs) == 1 and part.coherence is not None:
        return part.coherence[:, None, :]
    return np.full(part.H.shape, np.nan)


# ==== Local polynomial method, which estimates leakage together with the response ====================================
# Response and transient are smooth over a few bins. Over a narrow band around a frequency, with r from -1 to 1,
#
#     Y(f + r b) = [H + r h_1 + r^2 h_2 ...] U(f + r b) + [T + r t_1 + r^2 t_2 ...]
#
# for the spectra of whole, unwindowed records. T is the effect of the different states at the start and end of a
# record, and each record has its own. One linear regression per frequency gives H, and its residual gives the variance.
#
# Source: J. Schoukens, G. Vandersteen, K. Barbe, R. Pintelon, "Nonparametric preprocessing in system identification: a
# powerful tool", European Journal of Control 15 (2009) 260-274, doi 10.3166/ejc.15.260-274.

#: Correlation of an input of two tests above which it is the same drive.
_ALIKE = 0.7


@dataclass(frozen=True, slots=True)
class LocalPolynomial:
    """Local polynomial estimator."""

    #: Degree of the polynomials; 2 in the literature, higher for short records and lightly damped modes.
    degree: int = 2
    #: Half width b of a band [Hz], increased if it has too few bins. A wider band averages more noise, but the response
    #: varies more within it. None takes the smallest width with `spare` times as many equations as unknowns.
    half_width: float | None = None
    spare: float = 1.5  #: Minimum number of equations per unknown.
    spacing: float = 0.05  #: Spacing of the resulting frequencies [Hz]; at least that of the bins (1 / record length).
    high: float = 30.0  #: Highest frequency [Hz].
    power_floor: float = POWER_FLOOR  #: Relative amplitude below which an input is dropped [1].

    @classmethod
    def of_width(cls, width: float, high: float) -> LocalPolynomial:
        """Return an estimator with bands of a width [Hz] up to a frequency [Hz], and five frequencies in a band."""
        return cls(half_width=0.5 * width, spacing=0.2 * width, high=high)

    def __post_init__(self) -> None:
        if self.degree < 0 or self.spare <= 1.0 or self.spacing <= 0.0 or self.high <= 0.0:
            raise ParameterError(f"{self}: degree must be at least 0, spare above 1, spacing and high above 0")

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate from all records at once; each is truncated to the length of the shortest.

        Raises:
            TooShortError: The records have too few bins up to `high` for the number of inputs.
        """
        spectra = whole_spectra(records, self.high)
        n = self._bins(spectra, len(records.inputs))
        names = [channel.name for channel in records.inputs]
        active = powered(_band_amplitude(spectra.U, n), self.power_floor, names)
        step = max(1, round(self.spacing / spectra.frequency[0]))
        centres = np.arange(step - 1, spectra.frequency.size, step)
        solved = [_solve(spectra, int(k), n, self.degree, active[k]) for k in parts(centres)]
        typical = float(np.median([part.condition for part in solved]))
        if typical > WORST_CONDITION**1.5:
            raise InputError(
                f"the inputs {', '.join(names)} depend linearly on each other (condition {typical:.2g}): with linear "
                "shocks the rig's inputs determine the forces (Eq 5.34); add records with another shock at each corner"
            )
        H, coherence, variance = (np.stack([part[i] for part in solved], axis=-1) for i in range(3))
        frequency = spectra.frequency[centres]
        return FrequencyResponse(frequency, H, records.inputs, records.outputs, coherence, None, variance)

    def _bins(self, spectra: WholeSpectra, inputs: int) -> int:
        """Return n, where a band has 2 n + 1 bins.

        Drives that are repeated in several tests give no more information than in one test.
        """
        tests, count = spectra.U.shape[0], spectra.frequency.size
        together = (inputs + tests) / tests
        equations = self.spare * (self.degree + 1) * max(together, _repeated_inputs(spectra.U) + 1.0)
        chosen = round((self.half_width or 0.0) / float(spectra.frequency[0]))
        n = max(int(np.ceil((equations - 1.0) / 2.0)), chosen, 1)
        if 2 * n + 1 > count:
            raise TooShortError(
                f"the records have {count} bins up to {self.high:g} Hz, but {inputs} inputs and degree {self.degree} "
                f"need {2 * n + 1}; give longer records or fewer inputs"
            )
        return n


class WholeSpectra(NamedTuple):
    """Spectra of whole records, without a window."""

    frequency: Array  #: Frequencies (K,) [Hz].
    U: Complex  #: Spectra of the inputs (tests, K, m).
    Y: Complex  #: Spectra of the outputs (tests, K, p).


class _Local(NamedTuple):
    H: Complex
    coherence: Array
    variance: Array
    condition: float


def whole_spectra(records: Records, high: float) -> WholeSpectra:
    """Return the spectra of whole records up to a frequency [Hz]; each is truncated to the length of the shortest.

    Raises:
        InputError: The records have no frequency up to there.
    """
    size = min(test.u.shape[1] for test in records.tests)
    frequency = np.arange(size // 2 + 1) * (records.rate / size)
    kept = np.flatnonzero((frequency > 0.0) & (frequency <= min(high, 0.499 * records.rate)))
    if not kept.size:
        raise InputError(f"the records have no frequency between 0 and {high:g} Hz")
    U = np.stack([np.fft.rfft(test.u[:, :size])[:, kept].T for test in records.tests])
    Y = np.stack([np.fft.rfft(test.y[:, :size])[:, kept].T for test in records.tests])
    return WholeSpectra(frequency[kept], U, Y)


def _repeated_inputs(U: Complex) -> int:
    """Return the number of inputs that are about equal in all tests, from their spectra (tests, K, m)."""
    sizes = np.linalg.norm(U, axis=1)
    alike = np.abs(np.sum(U[:1].conj() * U, axis=1))
    return int(np.sum(np.all(alike > _ALIKE * sizes[:1] * sizes, axis=0)))


def _band_amplitude(U: Complex, n: int) -> Array:
    """Return the amplitude of each input (K, m) over bands of 2 n + 1 bins."""
    power = np.sum(np.abs(U) ** 2, axis=0)
    summed = np.concatenate((np.zeros((1, power.shape[1])), np.cumsum(power, axis=0)))
    k = np.arange(len(power))
    low, high = np.maximum(k - n, 0), np.minimum(k + n + 1, len(power))
    return np.asarray(np.sqrt((summed[high] - summed[low]) / (high - low)[:, None]))


def _solve(spectra: WholeSpectra, k: int, n: int, degree: int, active: NDArray[np.bool_]) -> _Local:
    """Solve the band around bin `k`; at the ends of the spectrum the band is one-sided."""
    first = min(max(k - n, 0), spectra.frequency.size - 2 * n - 1)
    band = slice(first, first + 2 * n + 1)
    bends = (np.arange(first - k, first - k + 2 * n + 1) / n)[:, None] ** np.arange(degree + 1)
    U = spectra.U[:, band][..., active]
    tests, _, m = U.shape
    response = (U[..., None, :] * bends[None, :, :, None]).reshape(tests, len(bends), -1)
    transient = np.einsum("ij,ke->ikje", np.eye(tests), bends).reshape(tests, len(bends), -1)
    # The first m columns are those of H itself.
    matrix = np.concatenate((response, transient), axis=2).reshape(tests * len(bends), -1)
    Y = spectra.Y[:, band].reshape(len(matrix), -1)
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0.0] = 1.0
    scaled = matrix / scale
    left, singular, right = np.linalg.svd(scaled, full_matrices=False)
    determined = singular > 1e-13 * singular[0]
    inverse = np.where(determined, 1.0 / np.where(determined, singular, 1.0), 0.0)
    V = right.conj().T * inverse
    solution = V @ (left.conj().T @ Y)
    noise = np.sum(np.abs(Y - scaled @ solution) ** 2, axis=0) / max(len(matrix) - int(determined.sum()), 1)
    total = np.mean(np.abs(Y) ** 2, axis=0)
    H = np.zeros((Y.shape[1], active.size), dtype=np.complex128)
    variance = np.full(H.shape, np.inf)
    H[:, active] = (solution[:m] / scale[:m, None]).T
    variance[:, active] = noise[:, None] * (np.sum(np.abs(V[:m]) ** 2, axis=1) / scale[:m] ** 2)[None]
    coherence = 1.0 - np.divide(noise, total, out=np.ones_like(total), where=total > 0.0)
    return _Local(H, np.clip(coherence, 0.0, 1.0), variance, float(singular[0] / max(singular[-1], 1e-300)))


# ==== Bias of an estimated response from noise of its measured inputs ================================================

#: Frequencies at which records have noise only, relative to their sample rate [1]: above the drive, and below the edge
#: of the decimation's filter.
_QUIET = (0.34, 0.39)

#: Duration of the blocks of the spectra [s].
_BLOCK = 8.0

#: Power over that of the noise from which an input counts as driven [1].
_DRIVEN = 10.0

#: Estimators by type, all of them regressions on the inputs.
_KINDS = {
    "H1": "H1",
    "LocalPolynomial": "local polynomials, a regression on the inputs like H1",
    "OutputErrorMethod": "output error, a simulation with the measured inputs, a regression on them like H1",
    "SameDrive": "differences of two tests with the same drive, like H1",
}


@dataclass(frozen=True, slots=True)
class InputNoise:
    """Attenuation of the responses to each input by its noise."""

    #: Relative reduction of the responses [1], median over the driven frequencies, by input; without inputs that are
    #: not driven.
    bias: Mapping[str, float]
    quiet: tuple[float, float]  #: Frequencies from which the noise was taken [Hz].

    def summary(self, estimator: object) -> str:
        """Return the estimator and its bias as a sentence."""
        kind = type(estimator).__name__
        sentence = f"Estimator: {_KINDS.get(kind, kind)}. Noise of the measured inputs makes its responses too small"
        if not self.bias:
            return f"{sentence}."
        worst: dict[str, str] = {}
        for name in sorted(self.bias, key=lambda name: -self.bias[name]):
            worst.setdefault(name.rpartition(".")[2], name)
        listed = ", ".join(f"{name} {100.0 * self.bias[name]:.2g} %" for name in worst.values())
        return (
            f"{sentence}: if the noise of the inputs is white and as large as their signals from {self.quiet[0]:.3g} "
            f"to {self.quiet[1]:.3g} Hz, by (worst input of each kind) {listed}."
        )


def input_noise(records: Records, band: tuple[float, float]) -> InputNoise:
    """Return the attenuation of a least-squares estimate in a band [Hz] by noise of its inputs.

    The part of an input that the other inputs do not explain has the power P; noise of power N in it reduces the
    responses to the input by

        N / P,  P = 1 / (S^-1)_jj

    with the spectral matrix S of the measured inputs, noise included.
    """
    size = min(*(test.u.shape[1] for test in records.tests), round(_BLOCK * records.rate))
    blocks = [np.moveaxis(stft(test.u, records.rate, nperseg=size, boundary=None, padded=False)[2], -1, 0)
              for test in records.tests]  # fmt: skip
    frequency = np.fft.rfftfreq(size, 1.0 / records.rate)
    every = np.concatenate(blocks)
    S = np.einsum("bik,bjk->kij", every, every.conj()) / len(every)  # spectral matrices (K, m, m)
    quiet = (_QUIET[0] * records.rate, _QUIET[1] * records.rate)
    power = np.real(np.einsum("kjj->jk", S))
    noise = power[:, (frequency >= quiet[0]) & (frequency <= quiet[1])].mean(axis=1)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    bias = _attenuation(S[inside], noise, power[:, inside] > _DRIVEN * noise[:, None])
    names = [channel.name for channel in records.inputs]
    return InputNoise({n: b for n, b in zip(names, bias.tolist(), strict=True) if np.isfinite(b)}, quiet)


def _attenuation(S: Complex, noise: Array, driven: Array) -> Array:
    """Return the median of N / P over the driven frequencies of each input (m,); NaN without one."""
    bias = np.full(driven.shape, np.nan)
    for k, matrix in enumerate(S):
        rows = np.flatnonzero(driven[:, k])
        if not rows.size:
            continue
        size = np.sqrt(np.real(np.diag(matrix))[rows])
        scaled = matrix[np.ix_(rows, rows)] / np.outer(size, size)
        alone = size**2 / np.real(np.diag(np.linalg.pinv(scaled)))
        bias[rows, k] = np.clip(noise[rows] / np.maximum(alone, 1e-300), 0.0, 1.0)
    return np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else np.nan for row in bias])
