"""Output-error fit: the parameters for which a free-running simulation comes closest to the measured outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.output_error.band import Band
from eightpost.ident.output_error.covariance import covariance
from eightpost.ident.output_error.gate import Gate, Tolerance, residual_gate
from eightpost.ident.output_error.model import Model, Record
from eightpost.ident.output_error.parameters import ParameterTable
from eightpost.ident.output_error.problem import Problem
from eightpost.progress import parts

#: Expected residual of the first pass, and smallest of the second, over the RMS of each output [1].
_FIRST, _LEAST = 0.02, 1e-4


@dataclass(frozen=True, slots=True)
class Shooting:
    """Strategy of the search.

    Multiple shooting divides every record into segments with unknown states at their starts, which the differences
    between segments pull together more and more. Its result starts a search in one piece (single shooting), which
    every fit ends with: the result is always that of a free-running simulation.
    """

    segments: int = 1  #: Number of segments of every record; 1 is single shooting only.
    stiffness: tuple[float, ...] = (0.1, 1.0, 10.0)  #: Weights of the differences between segments, one search each.
    evaluations: int = 40  #: Maximum number of evaluations of each search.
    tolerance: float = 1e-8  #: Relative change of cost and unknowns at which a search ends [1].
    #: Function that returns a guess of the states (N, n) of a record, e.g. from its measured outputs; None starts the
    #: segments with the states of a simulation with the start values.
    states: Callable[[Record], Array] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class OutputErrorFit:
    """Estimate of an output-error fit."""

    table: ParameterTable  #: Parameters.
    values: Mapping[str, float]  #: Estimated values by parameter.
    theta: Array  #: Estimated coordinates (F,); see `ParameterTable`.
    covariance: Array  #: Covariance (F, F) of the coordinates.
    residual: Mapping[str, float]  #: RMS of the residual in the band over that of the output [1], by output.
    gate: Gate  #: Verdict on the residuals.
    simulated: tuple[Array, ...]  #: Simulated outputs (N, Y) of every record.
    converged: bool  #: Whether the search ended at a minimum.
    message: str  #: Status of the search.
    seconds: float  #: Time of the fit [s].
    at_bounds: tuple[str, ...] = ()  #: Names of parameters at a bound; their intervals are not valid.

    @property
    def deviations(self) -> Mapping[str, float]:
        """Standard deviations of the values, in their units, by parameter."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return {p.name: float(s) * (self.values[p.name] if p.is_logarithmic else p.typical)
                for p, s in zip(self.table.free, sigma, strict=True)}  # fmt: skip

    def intervals(self, level: float = 0.95) -> Mapping[str, tuple[float, float]]:
        """Return the confidence intervals of the values, by parameter; those of logarithmic ones are not symmetric."""
        reach = norm.isf(0.5 * (1.0 - level)) * np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        low, high = self.table.values(self.theta - reach), self.table.values(self.theta + reach)
        pairs = {n: (float(a), float(b)) for n, a, b in zip(self.table.names, low, high, strict=True)}
        return {p.name: pairs[p.name] for p in self.table.free}

    def correlation(self, first: str, second: str) -> float:
        """Return the correlation of two estimates [1]."""
        names = [p.name for p in self.table.free]
        i, j = names.index(first), names.index(second)
        return float(self.covariance[i, j] / np.sqrt(self.covariance[i, i] * self.covariance[j, j]))

    def as_markdown(self) -> str:
        """Return a table of parameters with values, units, 95 % intervals and bounds."""
        lines = ["| parameter | value | 95 % interval | unit | bounds |", "|---|---|---|---|---|"]
        for p in self.table.free:
            low, high = self.intervals()[p.name]
            mark = " (at a bound)" if p.name in self.at_bounds else ""
            lines.append(
                f"| {p.name} | {self.values[p.name]:.5g}{mark} | {low:.5g} to {high:.5g} | {p.unit} | "
                f"{p.low:g} to {p.high:g} |"
            )
        return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class OutputError:
    """Settings of an output-error fit."""

    band: Band = field(default_factory=Band)  #: Frequency band of the residuals.
    shooting: Shooting = field(default_factory=Shooting)  #: Strategy of the search.
    #: Number of searches with residuals weighted by the noise that the previous one found; the first weights every
    #: output by its own RMS.
    passes: int = 2
    difference: float = 1e-5  #: Step of the finite differences, in the parameters' coordinates.
    tolerance: Tolerance = field(default_factory=Tolerance)  #: Limits of the gate.
    noise: tuple[float, ...] = ()  #: Known standard deviations of the outputs' noise (Y,); empty if they are not known.

    def fit(
        self,
        model: Model,
        table: ParameterTable,
        records: Sequence[Record],
        *,
        outputs: Sequence[str] = (),
        start: Mapping[str, float] | None = None,
    ) -> OutputErrorFit:
        """Fit a model to records.

        Args:
            model: Model, see `Model`.
            table: Parameters in the order of the model's values.
            records: Records with the same channels.
            outputs: Names of the outputs; default: y1, y2, ...
            start: Values where the search starts, by parameter; default: the start values of the table.

        Returns:
            The estimate; if the search did not converge, `converged` is False and `message` says why.

        Raises:
            ParameterError: There is no record, or the records or names do not match.
            TooShortError: A record has no line in the band.
        """
        _check(records, outputs)
        with threadpool_limits(1, "blas"):  # many small matrices: more threads are slower
            return self._fit(model, table, records, tuple(outputs), start or {})

    def _fit(
        self,
        model: Model,
        table: ParameterTable,
        records: Sequence[Record],
        outputs: Sequence[str],
        start: Mapping[str, float],
    ) -> OutputErrorFit:
        begun = perf_counter()
        names = tuple(outputs) or tuple(f"y{k + 1}" for k in range(records[0].outputs.shape[1]))
        sizes = np.sqrt(_powers(records, [r.outputs - r.counted(r.outputs).mean(axis=0) for r in records], self.band))
        noise = np.array(self.noise) if self.noise else _FIRST * sizes
        problem = Problem(model, table, records, self.band, noise, self.difference)
        theta = table.inside(table.theta(start))
        theta = self._multiple_shooting(problem, theta)
        for number in parts(range(1 if self.noise else self.passes)):
            if number:
                left = np.sqrt(_powers(records, _errors(problem, theta), self.band))
                problem = replace(problem, noise=np.maximum(left, _LEAST * sizes))
            found = self._search(problem, theta)
            theta = np.asarray(found.x)
        return self._result(problem, found, names, sizes, perf_counter() - begun)

    def _multiple_shooting(self, problem: Problem, theta: Array) -> Array:
        """Return coordinates (P,) from which single shooting converges."""
        if self.shooting.segments < 2:
            return theta
        cut = replace(problem, segments=self.shooting.segments)
        guess = self.shooting.states
        z = cut.states(theta) if guess is None else cut.states_from(theta, [guess(r) for r in problem.records])
        for stiffness in self.shooting.stiffness:
            z = np.asarray(self._search(replace(cut, stiffness=stiffness), z).x)
        return problem.table.inside(z[: theta.size])

    def _search(self, problem: Problem, z: Array) -> Any:
        how = self.shooting
        return least_squares(
            problem.residual,
            z,
            jac=problem.jacobian,
            bounds=problem.bounds(),
            x_scale="jac",
            ftol=how.tolerance,
            xtol=how.tolerance,
            gtol=None,
            max_nfev=how.evaluations,
        )

    def _result(
        self, problem: Problem, found: Any, names: Sequence[str], sizes: Array, seconds: float
    ) -> OutputErrorFit:
        theta, table = np.asarray(found.x), problem.table
        simulated = problem.simulated(theta)
        left = np.sqrt(_powers(problem.records, _errors(problem, theta), self.band))
        spread = covariance(problem.residual_lines(theta), problem.slope_lines(theta), self.band, table.prior_weights())
        bounds = zip((p.name for p in table.free), theta, *table.bounds(), strict=True)
        return OutputErrorFit(
            table,
            table.named(theta),
            theta,
            spread,
            dict(zip(names, (left / sizes).tolist(), strict=True)),
            residual_gate(names, problem.records, simulated, band=self.band, tolerance=self.tolerance),
            tuple(simulated),
            bool(found.status > 0) and bool(np.isfinite(left).all()),
            str(found.message),
            seconds,
            tuple(name for name, x, low, high in bounds if min(x - low, high - x) < 1e-5),
        )


def simulate(model: Model, values: Mapping[str, float], table: ParameterTable, record: Record) -> Array:
    """Return the outputs (N, Y) of a free-running simulation of a record, for values by parameter."""
    row = np.array([[values[name] for name in table.names]], dtype=np.float64)
    inputs = np.vstack([record.inputs, record.inputs[-1:]])
    return np.asarray(model.run(row, model.start(row), inputs, record.rate)[0][0])


def _errors(problem: Problem, theta: Array) -> list[Array]:
    return [y - record.outputs for y, record in zip(problem.simulated(theta), problem.records, strict=True)]


def _powers(records: Sequence[Record], signals: Sequence[Array], band: Band) -> Array:
    """Return the mean squares (Y,) per line in the band of signals (N, Y), as of white noise of the same power."""
    lines = [band.lines(record.counted(signal).T, record.rate) for record, signal in zip(records, signals, strict=True)]
    total = sum(np.sum(np.abs(line) ** 2, axis=1) for line in lines)
    return np.asarray(total / sum(2 * line.shape[1] for line in lines))


def _check(records: Sequence[Record], outputs: Sequence[str]) -> None:
    shapes = {(r.inputs.shape[1], r.outputs.shape[1]) for r in records}
    if len(shapes) != 1:
        raise ParameterError(f"the records have {len(shapes) or 'no'} kinds of channels; give records of one kind")
    if outputs and len(outputs) != next(iter(shapes))[1]:
        raise ParameterError(f"{len(outputs)} names of outputs are given for {next(iter(shapes))[1]} outputs")
