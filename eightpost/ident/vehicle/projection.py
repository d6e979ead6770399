"""Forces at the ports of a car, estimated from what no linear response explains."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex
from eightpost.errors import TooShortError
from eightpost.ident.response.records import Records
from eightpost.ident.threads import for_each
from eightpost.ident.vehicle.trust import ForceEstimate

# ---- Narrow bands of the spectra of whole records, in which each response is approximated by a polynomial -----------

_DEGREE = 2

#: Minimum number of equations per unknown.
_SPARE = 2.0

#: Amplitude of an input, relative to its largest, below which it has no power in a band [1].
_POWER_FLOOR = 1e-3


class Band(NamedTuple):
    """Spectra of all tests around one frequency."""

    frequency: float  #: Centre frequency of the band [Hz].
    U: Complex  #: Spectra of the inputs (tests, k, m).
    Y: Complex  #: Spectra of the outputs (tests, k, p).
    active: NDArray[np.bool_]  #: Mask of the inputs that have power (m,).

    def columns(self, U: Complex) -> Complex:
        """Return inputs U (tests, k, j) times powers of the position in the band, as columns (tests k, 3 j)."""
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


# ---- Forces at the ports from bands of spectra ----------------------------------------------------------------------


class ForceSolution(NamedTuple):
    """Estimated forces at the ports."""

    forces: Array  #: Forces F [N] (P,).
    covariance: Array  #: Covariance of the forces [N2] (P, P), from the scatter of the bands' gradients.
    residual: Array  #: Mean square residual of each output relative to that without the forces [1] (p,).

    @property
    def cost(self) -> float:
        """Mean of the residual over the outputs."""
        return float(self.residual.mean())

    def estimates(self, ports: Sequence[str]) -> dict[str, ForceEstimate]:
        """Return the force of every port with its standard deviation, by port."""
        deviation = np.sqrt(np.diag(self.covariance))
        pairs = zip(self.forces.tolist(), deviation.tolist(), strict=True)
        return {port: ForceEstimate(*pair) for port, pair in zip(ports, pairs, strict=True)}


def solve_forces(parts: Sequence[Band], inputs: int, iterations: int) -> ForceSolution:
    """Estimate the forces at the ports.

    Args:
        parts: Bands with `inputs` inputs, force inputs last, followed by the signal of a unit force at each port.
        inputs: Number of inputs without the signals of unit forces.
        iterations: Number of Gauss-Newton steps, starting from zero forces.
    """
    ports = parts[0].U.shape[2] - inputs
    forces = np.zeros(ports)
    noise = for_each(parts, lambda part: _BandFit.of(part, inputs, forces).noise)
    for _ in range(iterations):
        slopes = _slopes(parts, noise, inputs, forces)
        matrix = np.sum([slope.matrix for slope in slopes], axis=0)
        gradients = np.stack([slope.gradient for slope in slopes])
        inverse = np.linalg.inv(matrix)
        forces = forces + inverse @ gradients.sum(axis=0)
    # At the minimum the gradients of independent bands scatter around zero.
    scatter = gradients - gradients.mean(axis=0)
    left = np.divide(for_each(parts, lambda part: _BandFit.of(part, inputs, forces).noise), noise)
    return ForceSolution(forces, inverse @ (scatter.T @ scatter) @ inverse, np.mean(np.square(left), axis=0))


def _slopes(parts: Sequence[Band], noise: Sequence[Array], inputs: int, forces: Array) -> list[_Slopes]:
    weighted = zip(parts, noise, strict=True)
    return for_each(weighted, lambda pair: _BandFit.of(pair[0], inputs, forces).slopes(pair[1]))


class _Slopes(NamedTuple):
    matrix: Array
    gradient: Array


class _BandFit(NamedTuple):
    """Least-squares fit of a band for given forces at the ports."""

    band: Band
    inputs: int
    active: NDArray[np.bool_]
    Q: Complex
    coefficients: Complex
    misfit: Complex

    @classmethod
    def of(cls, band: Band, inputs: int, forces: Array) -> _BandFit:
        """Fit a band."""
        U = band.U[..., :inputs].copy()
        U[..., inputs - forces.size :] += band.U[..., inputs:] * forces
        # The force at a port is active in the same bands as the force input.
        active = band.active[:inputs]
        matrix = np.concatenate((band.columns(U[..., active]), band.transients()), axis=1)
        size = np.linalg.norm(matrix, axis=0)
        size[size == 0.0] = 1.0
        Q, R = np.linalg.qr(matrix / size)
        Y = band.Y.reshape(len(matrix), -1)
        share = Q.conj().T @ Y
        coefficients = np.linalg.lstsq(R, share, rcond=1e-13)[0] / size[:, None]
        return cls(band, inputs, active, Q, coefficients, Y - Q @ share)

    @property
    def noise(self) -> Array:
        """RMS of the residual per degree of freedom (p,)."""
        free = max(len(self.misfit) - self.Q.shape[1], 1)
        return np.asarray(np.sqrt(np.sum(np.abs(self.misfit) ** 2, axis=0) / free))

    def slopes(self, noise: Array) -> _Slopes:
        """Return the curvature (P, P) and the negative gradient (P,) of half the weighted residual by F."""
        ports = self.band.U.shape[2] - self.inputs
        explained = np.stack([self._explained(port, ports) / noise for port in range(ports)])
        flat = explained.reshape(ports, -1)
        misfit = (self.misfit / noise).reshape(-1)
        return _Slopes(np.real(flat.conj() @ flat.T), np.real(flat.conj() @ misfit))

    def _explained(self, port: int, ports: int) -> Complex:
        """Return the effect of a unit force at a port on the outputs (rows, p) that the columns cannot explain."""
        place = self.inputs - ports + port
        if not self.active[place]:
            return np.zeros_like(self.misfit)
        own, count = int(self.active[:place].sum()), int(self.active.sum())
        columns = self.band.columns(self.band.U[..., [self.inputs + port]])
        answer = columns @ self.coefficients[own::count][: columns.shape[1]]
        return np.asarray(answer - self.Q @ (self.Q.conj().T @ answer))
