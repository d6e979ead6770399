"""Uncertainty of parameters and curve, valid for correlated residuals.

The residual of a damper model is not white noise: it is what the law does not describe, and its correlation lasts as
long as that of the motion. So the rows are divided into blocks, and the uncertainty follows from the change of the
solution when a block is left out (delete-a-block jackknife to first order: a sandwich covariance corrected for
leverage).

A shock that warms or drifts during the test changes its parameters slowly, which blocks of 0.3 s do not show. So the
same is done with quarters and eighths of the records, and the widest of the three intervals counts.

The parameters are those at the mean temperature of the test, but the shock had other ones. So the residual is also
regressed on forces that grow with the temperature (with the time, where no temperature was measured), and the change of
the parameters from the middle of the temperatures to their ends is added to the interval.

Penalties move the solution in the same way in every part of the record. A law with many penalised parameters counts as
a bias of its intervals what leaving out each penalty would change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from eightpost.array_types import Array
from eightpost.ident.shock.runs import Runs

#: Length of a block [s]: ten periods of 20 Hz, and some 30 blocks in the dissertation's nine seconds.
BLOCK = 0.3

#: Minimum number of blocks; shorter records have shorter blocks.
_FEWEST_BLOCKS = 20

#: Numbers of long blocks, which show slow changes: warming, drift, differences between runs.
_LONG = (8, 4)

#: Level of the confidence intervals.
LEVEL = 0.95

#: Level of the intervals of the long blocks. As the widest of three intervals counts, 0.95 for each would cover 99 % of
#: records that do not change; this value covers 97 % of these (docs/explanation/shock_law.md).
_LONG_LEVEL = 0.925

#: Share of the range of the covariate that an interval contains on either side.
_STATES = 0.5

#: Singular values of the scaled Jacobian below this share of the largest are directions without information.
_NO_INFORMATION = 1e-7

#: Upper bound of a block's leverage in a direction, so that a block that alone determines it is not left out entirely.
_MOST_LEVERAGE = 0.98


@dataclass(frozen=True, slots=True, eq=False)
class CurveBand:
    """The 95 % band of a static curve, point by point, and that of a factor on each side."""

    velocity: Array  #: Velocities (M,) [m/s].
    force: Array  #: Static forces F_s (M,) [N].
    half_width: Array  #: Half-widths of the band (M,) [N].
    #: Half-widths of the factor on the force in compression and in rebound (2,) [1]; NaN for a side without samples.
    #: See `factor_rows`.
    factors: Array


def blocks_of(runs: Runs) -> list[slice]:
    """Return the blocks of rows that are treated as independent."""
    total = sum(f.rows.size / f.row_rate for f in runs.filters)
    return runs.blocks(min(BLOCK, total / _FEWEST_BLOCKS))


def quantile(runs: Runs) -> float:
    """Return the half-width of a 95 % interval in standard errors: Student's t for the number of blocks."""
    return _student(len(blocks_of(runs)), LEVEL)


def _student(blocks: int, level: float) -> float:
    return float(stdtrit(max(blocks - 1, 1), 0.5 + 0.5 * level))


def covariances(jacobian: Array, residual: Array, runs: Runs, penalties: Sequence[Array] = ()) -> Array:
    """Return the covariances (3, n, n) of parameters for short blocks, eighths and quarters of the records.

    Each is scaled so that `quantile(runs)` standard errors are the half-width of its 95 % interval; `standard_error`
    takes the largest. For the first three arguments see `covariance`.

    Args:
        jacobian: Jacobian of the residual.
        residual: Residual of the fit.
        runs: Records of the fit.
        penalties: Values (P,) of penalties that bias the parameters, in the order of the rows of the Jacobian behind
            those of the data. The bias is added to the half-widths as the root of the sum of squares.
    """
    short = blocks_of(runs)
    found = [covariance(jacobian, residual, runs)]
    for count in _LONG:
        ends = np.linspace(0, residual.size, count + 1).astype(int).tolist()
        widened = (_student(count, _LONG_LEVEL) / _student(len(short), LEVEL)) ** 2
        found.append(widened * covariance(jacobian, residual, runs, [slice(*pair) for pair in pairwise(ends)]))
    directions = _Directions.of(jacobian)
    moves = [_drift(directions, residual, runs)[None]]
    if penalties:
        moves.append(_without_penalties(directions, residual, penalties))
    bias = np.vstack(moves) / quantile(runs)
    return np.array(found) + bias.T @ bias


def block_changes(jacobian: Array, residual: Array, runs: Runs) -> Array:
    """Return the changes of the parameters (B, n) when each block of `blocks_of` is left out; see `covariance`."""
    return _Directions.of(jacobian).moves(residual, blocks_of(runs))


def _drift(directions: _Directions, residual: Array, runs: Runs) -> Array:
    """Return the changes of the parameters (n,) from the middle of the covariate, temperature or time, to its ends.

    The residual is regressed on three forces that grow with the covariate: shares of the force in compression and of
    that in rebound, and a constant one. The parameters change as the fit would if the measured force changed so.
    """
    root, covariate = np.sqrt(runs.weights), runs.covariate
    patterns = _slow_patterns(runs) * root[:, None]
    rows = directions.left[: residual.size]
    growing = covariate[:, None] * patterns
    seen = growing - rows @ (rows.T @ growing)  # the fit follows what the parameters can
    size = np.linalg.norm(seen, axis=0)
    size[size == 0.0] = 1.0
    gains = np.linalg.lstsq(seen / size, -residual, rcond=_NO_INFORMATION)[0] / size
    change = _STATES * float(np.ptp(covariate)) * (patterns @ gains)
    return np.asarray((rows.T @ change / directions.strength) @ directions.right / directions.size)


def _slow_patterns(runs: Runs) -> Array:
    """Return forces at the rows (R, 3) [N]: those in compression and in rebound without their mean, and 1 N."""
    force, mean = runs.target, float(np.average(runs.target, weights=runs.weights))
    compression = runs.row_velocity > 0.0
    return np.column_stack([(force - mean) * compression, (force - mean) * ~compression, np.ones(force.size)])


def _without_penalties(directions: _Directions, residual: Array, penalties: Sequence[Array]) -> Array:
    """Return the changes of the solution (G, n) when each of G penalties is left out, to first order."""
    ends = np.cumsum([residual.size, *(values.size for values in penalties)]).tolist()
    values = np.concatenate([residual, *penalties, np.zeros(len(directions.left) - ends[-1])])
    return directions.moves(values, [slice(*pair) for pair in pairwise(ends)])


def standard_error(rows: Array, covariances: Array) -> Array:
    """Return the standard errors (M,) of linear functions of parameters: rows (M, n), covariances (..., n, n)."""
    variances = np.einsum("mi,...ij,mj->...m", rows, covariances, rows).reshape(-1, rows.shape[0])
    return np.asarray(np.sqrt(np.maximum(variances.max(axis=0), 0.0)))


def covariance(jacobian: Array, residual: Array, runs: Runs, blocks: list[slice] | None = None) -> Array:
    """Return the covariance (n, n) of parameters from a Jacobian (R + T, n) and a residual (R,).

    Rows beyond the R rows of the runs are not data: they add stiffness but no scatter. Parameters that the record does
    not determine are NaN.

    Args:
        jacobian: Jacobian of the residual.
        residual: Residual of the fit.
        runs: Records of the fit.
        blocks: Blocks of rows that are treated as independent; None for those of `blocks_of`.
    """
    directions = _Directions.of(jacobian)
    moves = directions.moves(residual, blocks or blocks_of(runs))
    count = moves.shape[0]
    moves = moves - moves.mean(axis=0)
    result = (count - 1) / count * moves.T @ moves
    result[directions.unknown], result[:, directions.unknown] = np.nan, np.nan
    return np.asarray(result, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Directions:
    """Directions of the parameters (n,) that K singular vectors of a Jacobian (M, n) determine."""

    left: Array  #: Left singular vectors (M, K).
    strength: Array  #: Singular values (K,) of the Jacobian with columns of size 1.
    right: Array  #: Right singular vectors (K, n).
    size: Array  #: Sizes of the columns (n,).
    unknown: NDArray[np.bool_]  #: Whether each parameter (n,) is not determined.

    @classmethod
    def of(cls, jacobian: Array) -> _Directions:
        """Return the directions of a Jacobian."""
        size = np.linalg.norm(jacobian, axis=0)
        size[size == 0.0] = 1.0
        left, strength, directions = np.linalg.svd(jacobian / size, full_matrices=False)
        known = strength > _NO_INFORMATION * strength[0]
        unknown = 1.0 - np.sum(directions[known] ** 2, axis=0) > 1e-6
        return cls(left[:, known], strength[known], directions[known], size, unknown)

    def moves(self, residual: Array, blocks: list[slice]) -> Array:
        """Return the changes of the parameters (B, n) when each of B blocks of rows of a residual is left out."""
        return np.asarray((_moves(self.left, residual, blocks) / self.strength) @ self.right / self.size)


def _moves(orthogonal: Array, residual: Array, blocks: list[slice]) -> Array:
    """Return the changes of the solution (B, n), in orthogonal coordinates, when each block is left out.

    Without block b: (I - Q_b' Q_b)^-1 Q_b' r_b.
    """
    moves = []
    for block in blocks:
        q = orthogonal[block]
        if len(q) < q.shape[1]:  # a block of many settings' records determines few directions
            _, size, rows = np.linalg.svd(q, full_matrices=False)
            share, axes = size**2, rows.T
        else:
            share, axes = np.linalg.eigh(q.T @ q)
        left = 1.0 - np.minimum(share, _MOST_LEVERAGE)
        moves.append(axes @ ((axes.T @ (q.T @ residual[block])) / left))
    return np.array(moves)


def curve_band(columns: Array, samples: Array, b: Array, covariance: Array, velocity: Array, reach: float) -> CurveBand:
    """Return the band of a curve.

    Args:
        columns: Columns (M, n) of the curve at velocities (M,) [m/s].
        samples: Columns (R, n) of the curve at the samples of the records.
        b: Coefficients (n,) of the curve.
        covariance: Covariance (n, n) of b, or several (..., n, n), of which the largest counts at each velocity.
        velocity: Velocities (M,) [m/s].
        reach: Half-width of the band in standard errors.
    """
    factors = standard_error(factor_rows(samples, b), covariance)
    return CurveBand(velocity, columns @ b, reach * standard_error(columns, covariance), reach * factors)


def factor_rows(samples: Array, b: Array) -> Array:
    """Return the factor on the force in compression and in rebound as linear functions (2, n) of the coefficients.

    A change of the curve changes the force at each sample. The factor is the one that comes closest to this change
    (least squares over the samples of a side), so that errors of opposite sign at different velocities cancel as far
    as the covariance of the coefficients says. NaN for a side without samples.

    Args:
        samples: Columns (R, n) of the curve at the samples of the records.
        b: Coefficients (n,) of the curve.
    """
    force = samples @ b
    sides = (np.maximum(force, 0.0), np.minimum(force, 0.0))
    with np.errstate(invalid="ignore"):
        return np.array([side @ samples / (side @ side) for side in sides])
