"""A small polynomial NARX model of a damper, for comparison with the laws of `eightpost fit`.

    F(n) = polynomial of F(n-1), F(n-2), v(n), v(n-1), v(n-2), x(n)

All monomials up to a degree are fitted one step ahead by ridge regression (S. A. Billings, Nonlinear System
Identification, 2013) to low-passed signals at 200 Hz or the record's rate. Prediction is free-running: the model's own
forces are fed back, inside the range of the fitted forces, because a polynomial may diverge. Degree and ridge are those
with the lowest free-running error on the last quarter of the fitted records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eightpost.ident.shock.lag import RowFilter
from eightpost.ident.shock.record import Prepared, prepare
from eightpost.rig import DynoTest

Array = NDArray[np.float64]

#: Degrees and ridges [1] to compare, and the share of the records that they are compared on.
DEGREES, RIDGES, JUDGED = (1, 2, 3), (1e-8, 1e-6, 1e-4, 1e-2), 0.25

#: Number of past forces.
_PAST = 2


@dataclass(frozen=True, slots=True, eq=False)
class Narx:
    """A fitted model; all signals are scaled by their standard deviations.

    Attributes:
        weights: Weight of each monomial (M,).
        factors: Numbers of the signals in each monomial (M, degree); the constant 1 has number 0.
        scales: Scales of force [N], velocity [m/s] and displacement [m].
        reach: Lowest and highest scaled force of the fit.
    """

    weights: Array
    factors: NDArray[np.int64]
    scales: tuple[float, float, float]
    reach: tuple[float, float]

    def force(self, rows: Rows) -> Array:
        """Return the free-running force (R,) [N], which starts with the first measured values."""
        scaled = rows.scaled(self.scales)
        return self.scales[0] * _free(scaled.force, scaled.inputs, self.weights, self.factors, *self.reach)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Low-passed signals of one run at its rows.

    Attributes:
        force: Force (R,) [N].
        inputs: Inputs (R, 4): v(n), v(n-1), v(n-2) [m/s], x(n) [m].
    """

    force: Array
    inputs: Array

    @classmethod
    def of(cls, prepared: Prepared) -> Rows:
        """Return the rows of a prepared record."""
        rows = RowFilter.of(prepared.inside, prepared.rate, prepared.cutoff)
        velocity = rows(prepared.record["velocity"])
        has_displacement = "displacement" in prepared.record
        displacement = rows(prepared.record["displacement"]) if has_displacement else np.zeros(velocity.size)
        earlier = [np.concatenate([np.full(lag, velocity[0]), velocity[: velocity.size - lag]]) for lag in (0, 1, 2)]
        return cls(prepared.record["force"][rows.rows], np.column_stack([*earlier, displacement + prepared.reference]))

    def scaled(self, scales: tuple[float, float, float]) -> Rows:
        """Return the rows over scales."""
        force, velocity, displacement = scales
        return Rows(self.force / force, self.inputs / np.array([velocity, velocity, velocity, displacement]))

    def part(self, start: float, stop: float) -> Rows:
        """Return a part, from one share of the rows to another."""
        kept = slice(int(start * self.force.size), int(stop * self.force.size))
        return Rows(self.force[kept], self.inputs[kept])


def narx_error(model: Narx, prepared: Prepared) -> Array:
    """Return the error of the free-running force (R,) [N] at the rows of a record."""
    rows = Rows.of(prepared)
    return model.force(rows) - rows.force


def fit_narx(tests: Sequence[DynoTest], segment: tuple[float, float] | None = None) -> Narx:
    """Fit a model to one or more runs; degree and ridge are chosen on the last part of the runs."""
    runs = [Rows.of(prepare(test, segment=segment)) for test in tests]
    first, last = [run.part(0.0, 1.0 - JUDGED) for run in runs], [run.part(1.0 - JUDGED, 1.0) for run in runs]

    def error(options: tuple[int, float]) -> float:
        model = _fitted(first, *options)
        return sum(float(np.sum((model.force(run) - run.force) ** 2)) for run in last)

    return _fitted(runs, *min(product(DEGREES, RIDGES), key=error))


def _fitted(runs: Sequence[Rows], degree: int, ridge: float) -> Narx:
    force = np.concatenate([run.force for run in runs])
    inputs = np.vstack([run.inputs for run in runs])
    scales = (float(force.std()), float(inputs[:, 0].std()), float(inputs[:, -1].std()) or 1.0)
    factors = np.array(list(combinations_with_replacement(range(7), degree)), dtype=np.int64)
    rows, target = [], []
    for run in (run.scaled(scales) for run in runs):
        past = [run.force[_PAST - lag : run.force.size - lag] for lag in (1, 2)]
        signals = np.column_stack([np.ones(past[0].size), *past, run.inputs[_PAST:]])
        rows.append(np.prod(signals[:, factors], axis=2))
        target.append(run.force[_PAST:])
    columns, values = np.vstack(rows), np.concatenate(target)
    gram = columns.T @ columns + ridge * values.size * np.eye(columns.shape[1])
    reach = (float(force.min()) / scales[0], float(force.max()) / scales[0])
    return Narx(np.linalg.solve(gram, columns.T @ values), factors, scales, reach)


@njit(cache=True)
def _free(force: Array, inputs: Array, weights: Array, factors: NDArray[np.int64], low: float, high: float) -> Array:
    """Return the scaled force (R,) of a free run; the first values are the measured ones."""
    found = force.copy()
    signals = np.ones(7)
    for n in range(2, force.size):
        signals[1], signals[2] = found[n - 1], found[n - 2]
        signals[3:] = inputs[n]
        total = 0.0
        for m in range(weights.size):
            term = weights[m]
            for factor in factors[m]:
                term *= signals[factor]
            total += term
        found[n] = min(max(total, low), high)
    return found
