"""Local models with a bandwidth and poles chosen by validation, for lightly damped structures.

A polynomial of low degree cannot follow a mode that is as narrow as the band over which it is fitted. A mode is a
rational function, so a local model with a denominator can, over a band of any width:

    D(r) Y(f + r b) = N(r) U(f + r b) + T(r),   D(r) = 1 + d_1 r + d_2 r^2,   H(f) = N(0)

with N and T of the polynomials of `LocalPolynomial`. The regression is linear in the coefficients; it is repeated with
the equations divided by the denominator found, so that the residual is that of the output. At each frequency and for
each output, candidates without and with a denominator, over bands of several widths, predict each bin near the
frequency from the other bins, and the candidate with the smallest error is used.

Sources: T. McKelvey, G. Guerin, "Non-parametric frequency response estimation using a local rational model", IFAC
Proceedings 45 (2012) 49-54; and `local_polynomial`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident.response.averaged import POWER_FLOOR, powered
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.ident.response.local_polynomial import WholeSpectra, band_amplitude, repeated_inputs, whole_spectra
from eightpost.ident.response.records import Records

#: Number of bins on each side of a frequency at which predictions are compared.
_JUDGED = 2
#: Ratio of squared errors below which a model with a denominator is preferred to a polynomial.
_BETTER = 0.8
#: Smallest magnitude of a denominator by which equations are divided [1].
_LEAST = 0.02
#: Weight of an equation x = 0 for each scaled coefficient, for coefficients that the data do not determine.
_RIDGE = 1e-7
#: Largest leverage of an equation.
_LEVERAGE = 1.0 - 1e-6
#: Number of frequencies that are solved together.
_TOGETHER = 500
#: Largest entry of the inverse of scaled inputs above which they are dependent.
_DEPENDENT = 1e5


@dataclass(frozen=True, slots=True)
class LocalRational:
    """Local estimator that chooses its bandwidth and denominator by validation."""

    order: int = 2  #: Degree of the denominators, twice the number of modes within a band.
    degree: int = 2  #: Degree of the numerators and of the transients.
    #: Widths of the bands, relative to the narrowest with `spare` times as many equations as unknowns.
    widths: tuple[float, ...] = (1.0, 2.0)
    spare: float = 1.5  #: Minimum number of equations per unknown.
    spacing: float = 0.05  #: Spacing of the resulting frequencies [Hz]; at least that of the bins (1 / record length).
    high: float = 30.0  #: Highest frequency [Hz].
    power_floor: float = POWER_FLOOR  #: Relative amplitude below which an input is dropped [1]; see `H1`.

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.order < 1 or self.degree < 0 or not self.widths or min(self.widths) < 1.0:
            raise ParameterError(f"{self}: order must be at least 1, degree at least 0, and the widths at least 1")
        if self.spare <= 1.0 or self.spacing <= 0.0 or self.high <= 0.0:
            raise ParameterError(f"{self}: spare must be above 1, spacing and high above 0")

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate from all records at once; each is truncated to the length of the shortest.

        Raises:
            TooShortError: The records have too few bins up to `high` for the number of inputs.
        """
        return self.validated(records).response

    def validated(self, records: Records) -> ValidatedResponse:
        """Estimate as `estimate` does, and return the response with its prediction error.

        Raises:
            TooShortError: The records have too few bins up to `high` for the number of inputs.
        """
        spectra = whole_spectra(records, self.high)
        candidates = self._candidates(spectra)
        active = powered(
            band_amplitude(spectra.U, candidates[0].bins),
            self.power_floor,
            [channel.name for channel in records.inputs],
        )
        step = max(1, round(self.spacing / spectra.frequency[0]))
        centres = np.arange(step - 1, spectra.frequency.size, step)
        shape = (centres.size, spectra.Y.shape[2], spectra.U.shape[2])
        best = _Solved.empty(shape)
        for chunk, inputs in _groups(centres, active):
            tried = [_solve(spectra, centres[chunk], inputs, candidate) for candidate in candidates]
            best.put(chunk, inputs, _best(tried, candidates))
        _check_independent(best.spread, records)
        return _validated(records, spectra, centres, best)

    def _candidates(self, spectra: WholeSpectra) -> list[_Candidate]:
        """Return polynomials and models with a denominator, over bands of each width that the records have."""
        tests, count, inputs = spectra.U.shape
        together = max((inputs + tests) / tests, repeated_inputs(spectra.U) + 1.0)
        found = []
        for order in (0, self.order):
            equations = self.spare * ((self.degree + 1) * together + order)
            for width in self.widths:
                bins = max(int(np.ceil((width * equations - 1.0) / 2.0)), 1 + _JUDGED)
                if 2 * bins + 1 <= count:
                    found.append(_Candidate(bins, self.degree, order))
        if not found:
            raise TooShortError(
                f"the records have {count} bins up to {self.high:g} Hz, too few for {inputs} inputs and degree "
                f"{self.degree}; give longer records or fewer inputs"
            )
        return found


class ValidatedResponse(NamedTuple):
    """A response, and how well it predicts bins that were left out."""

    response: FrequencyResponse  #: Frequency response.
    error: Array  #: RMS error of predicted bins of each output (p, K), in the unit of the spectrum.
    level: Array  #: RMS of the spectrum of each output at the same bins (p, K).
    order: NDArray[np.intp]  #: Degree of the denominator that was chosen (p, K); 0 for polynomials.

    def findings(self, limit: float = 0.2) -> tuple[str, ...]:
        """Return for each output where the resolution is insufficient, a sentence with the error and a remedy.

        Args:
            limit: Largest relative error of predicted bins [1]. Frequencies at which an output is below 1 % of its
                largest level are left out.
        """
        rows = zip(self.response.output_names, self.error, self.level, strict=True)
        return tuple(filter(None, (self._finding(*row, limit) for row in rows)))

    def _finding(self, name: str, error: Array, level: Array, limit: float) -> str:
        bad = (error > limit * level) & (level > 0.01 * level.max())
        if not bad.any():
            return ""
        edges = np.flatnonzero(np.diff(np.concatenate(([0], bad.astype(np.int8), [0])))).reshape(-1, 2)
        frequency = self.response.frequency
        widest = sorted(sorted(edges.tolist(), key=lambda edge: edge[0] - edge[1])[:3])
        bands = ", ".join(f"{frequency[first]:.4g} to {frequency[last - 1]:.4g} Hz" for first, last in widest)
        share = float(np.sqrt(np.sum(error[bad] ** 2) / np.sum(level[bad] ** 2)))
        return (
            f"{name}: at {int(bad.sum())} of {bad.size} frequencies, among them {bands}, bins are predicted from their "
            f"neighbours with an error of {100.0 * share:.0f} % (limit {100.0 * limit:.0f} %): the response varies "
            "more between bins than the record resolves, or noise dominates; give longer records or more amplitude "
            "there"
        )


class _Candidate(NamedTuple):
    bins: int
    """Number of bins on each side."""
    degree: int
    order: int


class _Solved(NamedTuple):
    """Solutions at C frequencies."""

    H: Complex
    """Responses (C, p, m)."""
    variance: Array
    """Variances of the responses (C, p, m)."""
    noise: Array
    """Variances of the residuals (C, p)."""
    error: Array
    """Mean squares of prediction errors near the frequencies (C, p)."""
    spread: Array
    """Largest standard deviation of a response, relative to independent inputs (C, p)."""
    order: NDArray[np.intp]
    """Degrees of the denominators (C, p)."""

    @classmethod
    def empty(cls, shape: tuple[int, int, int]) -> _Solved:
        """Return a solution without inputs."""
        two = shape[:2]
        H = np.zeros(shape, dtype=np.complex128)
        noise, error, spread = (np.zeros(two) for _ in range(3))
        return cls(H, np.full(shape, np.inf), noise, error, spread, np.zeros(two, dtype=np.intp))

    def put(self, chunk: NDArray[np.intp], inputs: NDArray[np.intp], part: _Solved) -> None:
        """Set the solutions at some frequencies, with some inputs."""
        self.H[chunk[:, None], :, inputs] = part.H.transpose(0, 2, 1)
        self.variance[chunk[:, None], :, inputs] = part.variance.transpose(0, 2, 1)
        for mine, other in zip(self[2:], part[2:], strict=True):
            mine[chunk] = other


def _groups(
    centres: NDArray[np.intp], active: NDArray[np.bool_]
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Yield positions in `centres` that have the same active inputs, and these inputs."""
    patterns, which = np.unique(active[centres], axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        members = np.flatnonzero(which.ravel() == number)
        for first in range(0, members.size, _TOGETHER):
            yield members[first : first + _TOGETHER], np.flatnonzero(pattern)


def _best(tried: Sequence[_Solved], candidates: Sequence[_Candidate]) -> _Solved:
    """Return for each frequency and output the solution that predicts best; polynomials have priority."""
    factor = np.array([1.0 if candidate.order == 0 else 1.0 / _BETTER for candidate in candidates])
    chosen = np.argmin(np.stack([one.error for one in tried]) * factor[:, None, None], axis=0)
    return _Solved._make(_taken(np.stack(field), chosen) for field in zip(*tried, strict=True))


def _taken(stacked: NDArray[Any], chosen: NDArray[np.intp]) -> NDArray[Any]:
    """Return values (C, p) or (C, p, m) of the chosen candidates from those of all (candidates, C, p ...)."""
    which = chosen if stacked.ndim == 3 else chosen[..., None]
    return np.asarray(np.take_along_axis(stacked, which[None], axis=0)[0])


# ---- Solution of the bands around several frequencies at once -------------------------------------------------------


class _Band(NamedTuple):
    matrix: Complex
    """Columns of H, of the rest of the numerator and of the transients (C, R, n)."""
    place: Array
    """Position r of each equation (C, R)."""
    near: NDArray[np.bool_]
    """Mask of the equations near the frequency (C, R)."""
    span: NDArray[np.intp]
    """Bins of the band (C, B)."""


def _solve(spectra: WholeSpectra, centres: NDArray[np.intp], inputs: NDArray[np.intp], how: _Candidate) -> _Solved:
    band = _band(spectra, centres, inputs, how)
    parts = []
    for output in range(spectra.Y.shape[2]):
        y = spectra.Y[:, band.span, output].transpose(1, 0, 2).reshape(band.place.shape)
        parts.append(_one_output(band, y, how.order, inputs.size))
    orders = np.full((centres.size, len(parts)), how.order, dtype=np.intp)
    return _Solved._make([*(np.stack(field, axis=1) for field in zip(*parts, strict=True)), orders])


def _band(spectra: WholeSpectra, centres: NDArray[np.intp], inputs: NDArray[np.intp], how: _Candidate) -> _Band:
    tests, count, _ = spectra.U.shape
    first = np.clip(centres - how.bins, 0, count - 2 * how.bins - 1)
    index = first[:, None] + np.arange(2 * how.bins + 1)
    r = (index - centres[:, None]) / how.bins
    bends = r[..., None] ** np.arange(how.degree + 1)
    U = spectra.U[:, index][..., inputs].transpose(1, 0, 2, 3)
    numerator = bends[:, None, :, :, None] * U[:, :, :, None, :]
    transient = np.einsum("ij,cke->cikje", np.eye(tests), bends)
    shape = (centres.size, tests * index.shape[1], -1)
    matrix = np.concatenate((numerator.reshape(shape), transient.reshape(shape)), axis=2)
    near = np.abs(index - centres[:, None]) <= _JUDGED
    return _Band(matrix, np.tile(r, tests), np.tile(near, tests), index)


def _one_output(band: _Band, y: Complex, order: int, inputs: int) -> tuple[Complex, Array, Array, Array, Array]:
    """Return H, its variance, the noise, the prediction error and the relative spread for an output y (C, R)."""
    powers = band.place[..., None] ** np.arange(1, order + 1)
    matrix = np.concatenate((band.matrix, -y[..., None] * powers), axis=2)
    D = np.ones_like(y)
    for _ in range(2 if order else 1):
        weight = 1.0 / np.maximum(np.abs(D), _LEAST)
        solution, R, Q, scale = _least_squares(matrix * weight[..., None], y * weight)
        D = 1.0 + np.einsum("crk,ck->cr", powers, solution[:, solution.shape[1] - order :])
    residual = (y - np.einsum("crk,ck->cr", matrix, solution)) * weight
    freedom = max(matrix.shape[1] - matrix.shape[2], 1)
    noise = np.sum(np.abs(residual) ** 2, axis=1) / freedom
    inverse = np.linalg.inv(R)[:, :inputs]
    spread = np.sum(np.abs(inverse) ** 2, axis=2)
    leverage = np.minimum(np.sum(np.abs(Q) ** 2, axis=2), _LEVERAGE)
    predicted = residual / (1.0 - leverage) / (weight * np.maximum(np.abs(D), _LEAST))
    error = np.sum(np.abs(predicted) ** 2 * band.near, axis=1) / band.near.sum(axis=1)
    variance = noise[:, None] * spread / scale[:, :inputs] ** 2
    return solution[:, :inputs], variance, noise, error, np.sqrt(spread.max(axis=1, initial=0.0))


def _least_squares(matrix: Complex, y: Complex) -> tuple[Complex, Complex, Complex, Array]:
    """Return the solutions, the factors R and Q of the scaled matrices (C, R, n), and the scales (C, n)."""
    scale = np.linalg.norm(matrix, axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    count, rows, unknowns = matrix.shape
    ridge = np.broadcast_to(_RIDGE * np.eye(unknowns), (count, unknowns, unknowns))
    orthogonal, triangular = np.linalg.qr(np.concatenate((matrix / scale[:, None], ridge), axis=1))
    Q, R = np.asarray(orthogonal[:, :rows], np.complex128), np.asarray(triangular, np.complex128)
    solution = np.linalg.solve(R, np.einsum("crk,cr->ck", Q.conj(), y)[..., None])[..., 0]
    return np.asarray(solution / scale, np.complex128), R, Q, scale


def _check_independent(spread: Array, records: Records) -> None:
    if float(np.median(spread)) > _DEPENDENT:
        names = ", ".join(channel.name for channel in records.inputs)
        raise InputError(
            f"the inputs {names} depend linearly on each other in these records; add records with other combinations "
            "of the inputs"
        )


def _validated(records: Records, spectra: WholeSpectra, centres: NDArray[np.intp], best: _Solved) -> ValidatedResponse:
    power = np.mean(np.abs(spectra.Y) ** 2, axis=0)
    kernel = np.ones(2 * _JUDGED + 1)
    weight = np.convolve(np.ones(len(power)), kernel, mode="same")
    near = np.stack([np.convolve(row, kernel, mode="same") / weight for row in power.T])[:, centres]
    noise = best.noise.T
    coherence = np.clip(1.0 - np.divide(noise, near, out=np.ones_like(near), where=near > 0.0), 0.0, 1.0)
    H, variance = best.H.transpose(1, 2, 0).copy(), best.variance.transpose(1, 2, 0).copy()
    response = FrequencyResponse(
        spectra.frequency[centres], H, records.inputs, records.outputs, coherence, None, variance
    )
    return ValidatedResponse(response, np.sqrt(best.error.T), np.sqrt(near), best.order.T.copy())
