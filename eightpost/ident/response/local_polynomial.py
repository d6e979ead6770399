"""Local polynomial method, which estimates leakage together with the response.

Response and transient are smooth over a few bins. Over a narrow band around a frequency, with r from -1 to 1,

    Y(f + r b) = [H + r h_1 + r^2 h_2 ...] U(f + r b) + [T + r t_1 + r^2 t_2 ...]

for the spectra of whole, unwindowed records. T is the effect of the different states at the start and end of a record,
and each record has its own. One linear regression per frequency gives H, and its residual gives the variance.

Source: J. Schoukens, G. Vandersteen, K. Barbe, R. Pintelon, "Nonparametric preprocessing in system identification: a
powerful tool", European Journal of Control 15 (2009) 260-274, doi 10.3166/ejc.15.260-274.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident.response.averaged import POWER_FLOOR, WORST_CONDITION, powered
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.ident.response.records import Records
from eightpost.progress import parts

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
        """Check the ranges."""
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
        active = powered(band_amplitude(spectra.U, n), self.power_floor, names)
        step = max(1, round(self.spacing / spectra.frequency[0]))
        centres = np.arange(step - 1, spectra.frequency.size, step)
        solved = [_solve(spectra, int(k), n, self.degree, active[k]) for k in parts(centres)]
        _check_conditions([part.condition for part in solved], names)
        H, coherence, variance = (np.stack([part[i] for part in solved], axis=-1) for i in range(3))
        frequency = spectra.frequency[centres]
        return FrequencyResponse(frequency, H, records.inputs, records.outputs, coherence, None, variance)

    def _bins(self, spectra: WholeSpectra, inputs: int) -> int:
        """Return n, where a band has 2 n + 1 bins.

        Drives that are repeated in several tests give no more information than in one test.
        """
        tests, count = spectra.U.shape[0], spectra.frequency.size
        together = (inputs + tests) / tests
        equations = self.spare * (self.degree + 1) * max(together, repeated_inputs(spectra.U) + 1.0)
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

    frequency: Array
    """Frequencies (K,) [Hz]."""
    U: Complex
    """Spectra of the inputs (tests, K, m)."""
    Y: Complex
    """Spectra of the outputs (tests, K, p)."""


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


def repeated_inputs(U: Complex) -> int:
    """Return the number of inputs that are about equal in all tests, from their spectra (tests, K, m)."""
    sizes = np.linalg.norm(U, axis=1)
    alike = np.abs(np.sum(U[:1].conj() * U, axis=1))
    return int(np.sum(np.all(alike > _ALIKE * sizes[:1] * sizes, axis=0)))


def band_amplitude(U: Complex, n: int) -> Array:
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
    U, Y = spectra.U[:, band][..., active], spectra.Y[:, band]
    tests, _, m = U.shape
    response = (U[..., None, :] * bends[None, :, :, None]).reshape(tests, len(bends), -1)
    transient = np.einsum("ij,ke->ikje", np.eye(tests), bends).reshape(tests, len(bends), -1)
    # The first m columns are those of H itself.
    matrix = np.concatenate((response, transient), axis=2).reshape(tests * len(bends), -1)
    return _least_squares(matrix, Y.reshape(tests * len(bends), -1), active, m)


def _least_squares(matrix: Complex, Y: Complex, active: NDArray[np.bool_], m: int) -> _Local:
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0.0] = 1.0
    scaled = matrix / scale
    left, singular, right = np.linalg.svd(scaled, full_matrices=False)
    kept = singular > 1e-13 * singular[0]
    inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
    V = right.conj().T * inverse
    solution = V @ (left.conj().T @ Y)
    noise = np.sum(np.abs(Y - scaled @ solution) ** 2, axis=0) / max(len(matrix) - int(kept.sum()), 1)
    total = np.mean(np.abs(Y) ** 2, axis=0)
    H = np.zeros((Y.shape[1], active.size), dtype=np.complex128)
    variance = np.full(H.shape, np.inf)
    H[:, active] = (solution[:m] / scale[:m, None]).T
    variance[:, active] = noise[:, None] * (np.sum(np.abs(V[:m]) ** 2, axis=1) / scale[:m] ** 2)[None]
    coherence = 1.0 - np.divide(noise, total, out=np.ones_like(total), where=total > 0.0)
    return _Local(H, np.clip(coherence, 0.0, 1.0), variance, float(singular[0] / max(singular[-1], 1e-300)))


def _check_conditions(conditions: list[float], names: list[str]) -> None:
    typical = float(np.median(conditions))
    if typical > WORST_CONDITION**1.5:
        raise InputError(
            f"the inputs {', '.join(names)} depend linearly on each other (condition {typical:.2g}): with linear "
            "shocks the rig's inputs determine the forces (Eq 5.34); add records with another shock at each corner"
        )
