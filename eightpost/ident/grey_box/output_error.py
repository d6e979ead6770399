"""Output-error fit: the parameters for which a free-running simulation comes closest to the measured outputs.

The residuals are the spectral lines of simulated minus measured outputs over the expected noise, and the priors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares
from scipy.signal import get_window
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.ident.threads import for_each
from eightpost.progress import beat, parts
from eightpost.workers.process import usable_processors

#: Expected residual of the first pass, and smallest of the second, over the RMS of each output [1].
_FIRST, _LEAST = 0.02, 1e-4

#: Maximum number of evaluations of a search, and relative change of cost and coordinates at which it ends [1].
_EVALUATIONS, _ENDS = 15, 1e-4

#: Step of the finite differences, in the parameters' coordinates.
_STEP = 1e-4

#: Distance of a start from its bounds, and distance at which an estimate is at a bound, relative and in coordinates.
_INSIDE, _AT_BOUND = 1e-6, 1e-5

#: Value that replaces residuals of simulations that diverged, relative to the expected noise.
_DIVERGED = 1e6

#: Minimum number of simulations per thread.
_TOGETHER = 2

#: Number of neighbouring lines that the windows correlate, and minimum number over which a spectrum is averaged.
_REACH, _WIDTH = 2, 5


# ---- Parameters -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a model, with what is known about it before the fit.

    Raises:
        ParameterError: The start is outside the bounds, or the prior is not above zero.
    """

    name: str  #: Name.
    unit: str  #: SI unit.
    start: float  #: Start value; with a prior, also its mean (median if the coordinate is a logarithm).
    low: float  #: Lower bound.
    high: float  #: Upper bound.
    size: float | None  #: The optimiser's coordinate is the value over this size; None: the logarithm of the value.
    #: Standard deviation of the prior, in the unit of the parameter, or of the logarithm; None without a prior.
    prior: float | None = None
    fixed: bool = False  #: Whether the parameter keeps its start value.

    def __post_init__(self) -> None:
        if not self.low <= self.start <= self.high:
            raise ParameterError(
                f"{self.name}: the start {self.start:g} {self.unit} must be within the bounds {self.low:g} to "
                f"{self.high:g} {self.unit}"
            )
        if self.prior is not None and not self.prior > 0.0:
            raise ParameterError(f"{self.name}: the standard deviation of the prior is {self.prior!r}; it must be > 0")


@dataclass(frozen=True)
class ParameterTable:
    """P parameters in the order of a model's values, of which F are not fixed."""

    parameters: tuple[Parameter, ...]  #: Parameters with unique names.

    def __iter__(self) -> Iterator[Parameter]:
        """Iterate over all parameters."""
        return iter(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters."""
        return tuple(parameter.name for parameter in self)

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """The F parameters that are not fixed, in the order of the optimiser's coordinates."""
        return tuple(parameter for parameter in self if not parameter.fixed)

    def fixed(self, *names: str) -> ParameterTable:
        """Return the table in which exactly the given parameters are fixed."""
        return ParameterTable(tuple(replace(p, fixed=p.name in names) for p in self))

    def check(self, names: Iterable[str]) -> None:
        """Raise ParameterError if there is no parameter with one of the names."""
        unknown = sorted(set(names) - set(self.names))
        if unknown:
            raise ParameterError(
                f"there is no parameter {', '.join(unknown)}; the parameters are {', '.join(self.names)}"
            )

    @cached_property
    def _logarithmic(self) -> NDArray[np.bool_]:
        return np.array([p.size is None for p in self.free], dtype=bool)

    @cached_property
    def _sizes(self) -> Array:
        return np.array([p.size or 1.0 for p in self.free], dtype=np.float64)

    def theta(self, values: Mapping[str, float]) -> Array:
        """Return the optimiser's coordinates (F,) of values by name; missing ones have their start values."""
        return self._coordinates(values.get(p.name, p.start) for p in self.free)

    def _coordinates(self, values: Iterable[float]) -> Array:
        given = np.array([*values], dtype=np.float64)
        safe = np.where(self._logarithmic, np.maximum(given, 1e-300), 1.0)
        return np.asarray(np.where(self._logarithmic, np.log(safe), given / self._sizes))

    def values(self, theta: Array) -> Array:
        """Return the values (..., P) of coordinates (..., F), with the start values of fixed parameters."""
        found = np.empty((*theta.shape[:-1], len(self.parameters)))
        found[...] = [p.start for p in self]
        logarithms = np.where(self._logarithmic, theta, 0.0)
        is_free = np.array([not p.fixed for p in self], dtype=bool)
        found[..., is_free] = np.where(self._logarithmic, np.exp(logarithms), theta * self._sizes)
        return found

    def named(self, theta: Array) -> dict[str, float]:
        """Return the values of coordinates (F,) by name."""
        return dict(zip(self.names, self.values(theta).tolist(), strict=True))

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest coordinates (F,)."""
        return self._coordinates(p.low for p in self.free), self._coordinates(p.high for p in self.free)

    def inside(self, theta: Array) -> Array:
        """Return coordinates (F,) moved slightly inside the bounds."""
        low, high = self.bounds()
        gap = _INSIDE * (high - low)
        return np.asarray(np.clip(theta, low + gap, high - gap))

    def prior_weights(self) -> Array:
        """Return one over the prior's standard deviation in coordinates (F,); 0 without a prior."""
        return np.array([0.0 if p.prior is None else (p.size or 1.0) / p.prior for p in self.free], dtype=np.float64)


# ---- Records, models, and the band in which residuals count ---------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Measured inputs and outputs of one experiment."""

    inputs: Array  #: Inputs (N, U).
    outputs: Array  #: Measured outputs (N, Y).
    rate: float  #: Sample rate [Hz].
    settling: int = 0  #: Number of samples at the start that are simulated and do not count.

    def counted(self, signals: Array) -> Array:
        """Return signals (..., N, Y) of the record without the settling at the start."""
        return signals[..., self.settling :, :]


class Model(Protocol):
    """A model that is simulated from rest for K sets of P parameters at once."""

    def run(self, values: Array, inputs: Array, rate: float) -> Array:
        """Return the outputs (K, N, Y) for parameters (K, P), inputs (N, U) and a sample rate [Hz]."""
        ...


@dataclass(frozen=True, slots=True)
class Band:
    """Frequency band in which residuals are counted; the default is every line, the same as the time domain (Parseval).

    White noise of standard deviation s has a standard deviation s in the real and in the imaginary part of each line.
    """

    low: float = 0.0  #: Lowest frequency [Hz].
    high: float = np.inf  #: Highest frequency [Hz].
    #: Window over a whole record: `boxcar`, or `hann` if slow transients and offsets must not leak.
    window: Literal["boxcar", "hann"] = "boxcar"

    def frequencies(self, samples: int, rate: float) -> Array:
        """Return the frequencies (B,) [Hz] of the lines of a record of N samples."""
        every = np.fft.rfftfreq(samples, 1.0 / rate)
        return np.asarray(every[(every >= self.low) & (every <= self.high)], dtype=np.float64)

    def lines(self, signals: Array, rate: float) -> Complex:
        """Return the spectral lines (..., B) of signals (..., N)."""
        samples = signals.shape[-1]
        every = np.fft.rfftfreq(samples, 1.0 / rate)
        kept = (every >= self.low) & (every <= self.high)
        window = get_window(self.window, samples)
        spectrum = np.fft.rfft(signals * (window / np.sqrt(np.mean(window**2))), norm="ortho")[..., kept]
        both_sides = np.where((every[kept] > 0.0) & (every[kept] < 0.5 * rate), np.sqrt(2.0), 1.0)
        return np.asarray(spectrum * both_sides)


# ---- The fit --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class OutputErrorFit:
    """Estimate of an output-error fit."""

    table: ParameterTable  #: Parameters.
    values: Mapping[str, float]  #: Estimated values by parameter.
    theta: Array  #: Estimated coordinates (F,); see `ParameterTable`.
    covariance: Array  #: Covariance (F, F) of the coordinates.
    residual: Mapping[str, float]  #: RMS of the residual in the band over that of the output [1], by output.
    simulated: tuple[Array, ...]  #: Simulated outputs (N, Y) of every record.
    message: str = ""  #: Status of a search that did not converge; empty if it converged.
    at_bounds: tuple[str, ...] = ()  #: Names of parameters at a bound; their intervals are not valid.

    @property
    def deviations(self) -> Mapping[str, float]:
        """Standard deviations of the values, in their units, by parameter."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return {p.name: float(s) * (self.values[p.name] if p.size is None else p.size)
                for p, s in zip(self.table.free, sigma, strict=True)}  # fmt: skip

    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """Return the 95 % intervals of the values, by parameter; those of logarithmic ones are not symmetric."""
        reach = norm.isf(0.025) * np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        low, high = (self.table.named(self.theta + side * reach) for side in (-1.0, 1.0))
        return {p.name: (low[p.name], high[p.name]) for p in self.table.free}


@dataclass(frozen=True, slots=True)
class OutputErrorMethod:
    """Settings of an output-error fit."""

    band: Band = field(default_factory=Band)  #: Frequency band of the residuals.
    #: Number of searches with residuals weighted by the noise that the previous one found; the first weights every
    #: output by its own RMS.
    passes: int = 2

    def fit(
        self,
        model: Model,
        table: ParameterTable,
        records: Sequence[Record],
        outputs: Sequence[str],
        *,
        start: Mapping[str, float] | None = None,
    ) -> OutputErrorFit:
        """Fit a model with these parameters to records with these outputs; `start` replaces start values."""
        sizes = np.sqrt(_powers(records, [r.outputs - r.counted(r.outputs).mean(axis=0) for r in records], self.band))
        problem = _Problem(model, table, records, self.band, _FIRST * sizes)
        theta = table.inside(table.theta(start or {}))
        with threadpool_limits(1, "blas"):  # many small matrices: more threads are slower
            for number in parts(range(self.passes)):
                if number:
                    problem = replace(problem, noise=np.maximum(problem.left(theta), _LEAST * sizes))
                found = problem.search(theta)
                theta = np.asarray(found.x)
            left, bounds = problem.left(theta), zip(table.free, theta, *table.bounds(), strict=True)
            converged = found.status > 0 and np.isfinite(left).all()
            return OutputErrorFit(
                table,
                table.named(theta),
                theta,
                _covariance(problem, theta),
                dict(zip(outputs, (left / sizes).tolist(), strict=True)),
                tuple(problem.simulated(theta)),
                "" if converged else str(found.message),
                tuple(p.name for p, x, low, high in bounds if min(x - low, high - x) < _AT_BOUND),
            )


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least-squares problem of a search over coordinates theta (F,)."""

    model: Model
    table: ParameterTable
    records: Sequence[Record]
    band: Band
    noise: Array  #: Expected standard deviation of each output's residual (Y,).

    def search(self, theta: Array) -> Any:
        """Return the minimum that scipy finds from a start."""
        how: dict[str, Any] = {"ftol": _ENDS, "xtol": _ENDS, "gtol": None, "max_nfev": _EVALUATIONS, "x_scale": "jac"}
        return least_squares(self._residual, theta, jac=self._jacobian, bounds=self.table.bounds(), **how)

    def left(self, theta: Array) -> Array:
        """Return the RMS (Y,) of simulated minus measured outputs in the band."""
        errors = [y - record.outputs for y, record in zip(self.simulated(theta), self.records, strict=True)]
        return np.sqrt(_powers(self.records, errors, self.band))

    def simulated(self, theta: Array) -> list[Array]:
        """Return the outputs (N, Y) of every record."""
        return [y[0] for y in self._run(theta[None])]

    def lines(self, theta: Array) -> list[Complex]:
        """Return the spectral lines (Y, B) of simulated minus measured outputs over the noise, for every record."""
        outputs = self.simulated(theta)
        return [self._lines(r, _bounded(y - r.outputs, self.noise)) for r, y in zip(self.records, outputs, strict=True)]

    def slopes(self, theta: Array) -> list[Complex]:
        """Return the derivatives (F, Y, B) of `lines` by theta."""
        outputs = self._run(np.vstack([theta[None], theta + _STEP * np.eye(theta.size)]))
        changes = [_bounded((y[1:] - y[:1]) / _STEP, self.noise) for y in outputs]
        return [self._lines(record, change) for record, change in zip(self.records, changes, strict=True)]

    def _lines(self, record: Record, signals: Array) -> Complex:
        return self.band.lines(np.moveaxis(record.counted(signals), -1, -2) / self.noise[:, None], record.rate)

    def _residual(self, theta: Array) -> Array:
        beat()
        weights = self.table.prior_weights()
        prior = (weights * (theta - self.table.theta({})))[weights > 0.0]
        return _finite(np.concatenate([*(_real(lines) for lines in self.lines(theta)), prior]))

    def _jacobian(self, theta: Array) -> Array:
        beat()
        weights = self.table.prior_weights()
        prior = np.diag(weights)[weights > 0.0]
        return _finite(np.vstack([*(_real(slopes).T for slopes in self.slopes(theta)), prior]), 0.0)

    def _run(self, theta: Array) -> list[Array]:
        """Return the outputs (K, N, Y) of every record for coordinates (K, F), simulated in threads."""
        count = max(1, min(usable_processors(), len(theta) // _TOGETHER))
        pieces = np.array_split(self.table.values(theta), count)
        jobs = [(record, values) for record in self.records for values in pieces]
        found = for_each(jobs, lambda job: self.model.run(job[1], job[0].inputs, job[0].rate))
        return [np.concatenate(found[k : k + count]) for k in range(0, len(found), count)]


def _covariance(problem: _Problem, theta: Array) -> Array:
    """Return the covariance (F, F) of estimated coordinates.

        cov = A^-1 M A^-1,  A = sum_f Re J_f^H J_f + Lambda,  M = 1/2 sum_fg Re J_f^H C_fg J_g + Lambda

    C_fg is the covariance of the residual's spectral lines: its smoothed spectrum (between all outputs) times the
    correlation of the window's lines. Coloured residuals therefore widen the intervals as they must. Lambda is the
    inverse of the prior's covariance.
    """
    residuals, slopes, prior = problem.lines(theta), problem.slopes(theta), problem.table.prior_weights()
    count, squared = len(prior), get_window(problem.band.window, 4096) ** 2
    correlations = np.real(np.fft.rfft(squared))[: _REACH + 1] / squared.sum()  # of lines 0, 1, ... apart
    curvature, scatter = np.diag(prior**2), np.zeros((count, count))
    for r, J in zip(residuals, slopes, strict=True):
        flat = J.reshape(count, -1)
        curvature = curvature + np.real(flat.conj() @ flat.T)
        scatter = scatter + _scatter(r, J, correlations)
    values = 2 * sum(r.size for r in residuals)
    inverse = np.linalg.pinv(curvature, hermitian=True)
    scatter = scatter * (values / max(values - count, 1)) + np.diag(prior**2)
    return np.asarray(inverse @ scatter @ inverse)


def _scatter(r: Complex, J: Complex, correlations: Array) -> Array:
    """Return 1/2 sum_fg Re J_f^H C_fg J_g of one record, with residuals (Y, B) and slopes (F, Y, B)."""
    lines = r.shape[1]
    width = min(lines, max(_WIDTH, round(lines**0.5)))
    products = r[:, None, :] * r[None].conj()
    spectrum = uniform_filter1d(products.real, width) + 1j * uniform_filter1d(products.imag, width)
    driven = np.einsum("yzf,pzf->pyf", spectrum, J)
    found = 0.0
    for apart, share in enumerate(correlations):
        if apart < lines and abs(share) > 1e-9:
            part = np.real(np.einsum("pyf,qyf->pq", J[..., : lines - apart].conj(), driven[..., apart:]))
            found = found + share * (part if apart == 0 else part + part.T)
    return 0.5 * np.asarray(found)


def _powers(records: Sequence[Record], signals: Sequence[Array], band: Band) -> Array:
    """Return the mean squares (Y,) per line in the band of signals (N, Y), as of white noise of the same power."""
    lines = [band.lines(record.counted(signal).T, record.rate) for record, signal in zip(records, signals, strict=True)]
    total = sum(np.sum(np.abs(line) ** 2, axis=1) for line in lines)
    return np.asarray(total / sum(2 * line.shape[1] for line in lines))


def _real(lines: Complex) -> Array:
    """Return lines (..., Y, B) as real and imaginary parts (..., 2 Y B)."""
    flat = lines.reshape(*lines.shape[:-2], -1)
    return np.concatenate([flat.real, flat.imag], axis=-1)


def _finite(values: Array, otherwise: float = _DIVERGED) -> Array:
    return np.nan_to_num(values, nan=otherwise, posinf=otherwise, neginf=-otherwise)


def _bounded(signals: Array, noise: Array) -> Array:
    """Return signals (..., Y) in which values that overflowed are large and finite."""
    limit = _DIVERGED * noise
    return np.clip(np.nan_to_num(signals, nan=_DIVERGED, posinf=_DIVERGED, neginf=-_DIVERGED), -limit, limit)
