"""Narrow bands of the spectra of whole records, in which each response is approximated by a polynomial.

This is the local polynomial method, but without overlap of the bands, so that their residuals are independent.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.errors import TooShortError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from eightpost.ident.response.records import Records

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

_DEGREE = 2

#: Minimum number of equations per unknown.
_SPARE = 2.0

#: Amplitude of an input, relative to its largest, below which it has no power in a band [1].
_POWER_FLOOR = 1e-3


class Band(NamedTuple):
    """Spectra of all tests around one frequency.

    Attributes:
        frequency: Centre frequency of the band [Hz].
        U: Spectra of the inputs (tests, k, m).
        Y: Spectra of the outputs (tests, k, p).
        active: Mask of the inputs that have power (m,).
    """

    frequency: float
    U: Complex
    Y: Complex
    active: NDArray[np.bool_]

    def columns(self, U: Complex) -> Complex:
        """Return inputs (tests, k, j) times powers of the position in the band, as columns (tests k, 3 j)."""
        tests, k, _ = U.shape
        return np.asarray((U[..., None, :] * _bends(k)[None, :, :, None]).reshape(tests * k, -1))

    def transients(self) -> Complex:
        """Return the columns (tests k, 3 tests) that represent the transients of each record."""
        tests, k, _ = self.U.shape
        columns = np.einsum("ij,ke->ikje", np.eye(tests), _bends(k)).reshape(tests * k, -1)
        return np.asarray(columns, dtype=np.complex128)


def _bends(k: int) -> Array:
    return np.linspace(-1.0, 1.0, k)[:, None] ** np.arange(_DEGREE + 1)


def bands(records: Records, *, low: float, high: float, inputs: int) -> Iterator[Band]:
    """Yield the bands from `low` to `high` [Hz].

    Args:
        records: Records of the tests.
        low: Lowest frequency [Hz].
        high: Highest frequency [Hz].
        inputs: Number of inputs that are fitted at once; it determines the width of the bands.

    Raises:
        TooShortError: The records have too few frequency bins for one band.
    """
    size = min(test.u.shape[1] for test in records.tests)
    lines = np.arange(size // 2 + 1) * (records.rate / size)
    kept = np.flatnonzero((lines >= low) & (lines <= high))
    tests = len(records.tests)
    width = int(np.ceil(_SPARE * (_DEGREE + 1) * (inputs + tests) / tests))
    width = max(width, (_DEGREE + 1) * (inputs + 2))
    if kept.size < width:
        raise TooShortError(
            f"the records have {kept.size} frequency bins from {low:g} to {high:g} Hz, but {inputs} inputs need "
            f"{width}; use longer records"
        )
    U, Y = (_spectra(rows, size, kept) for rows in ([t.u for t in records.tests], [t.y for t in records.tests]))
    power = np.mean(np.abs(U) ** 2, axis=0)
    starts = range(0, kept.size - width + 1, width)
    local = np.stack([power[k : k + width].mean(axis=0) for k in starts])
    active = local > _POWER_FLOOR**2 * local.max(axis=0)
    for k, mask in zip(starts, active, strict=True):
        part = slice(k, k + width)
        yield Band(float(lines[kept[k + width // 2]]), U[:, part], Y[:, part], mask)


def _spectra(rows: Sequence[Array], size: int, kept: NDArray[np.intp]) -> Complex:
    return np.stack([np.fft.rfft(values[:, :size])[:, kept].T for values in rows])
