"""Uncertainty of a fitted shock's static curve and of its other parameters, as the shock file states it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.problem import Solution
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.uncertainty import CurveBand, blocks_of, curve_band, factor_rows, quantile
from eightpost.left_out_blocks import LeftOutBlocks

#: Number of velocities at which the curve's band is stated.
_BAND = 61

#: Parameters of the FMU that are the factors on the force in compression and in rebound.
_FACTORS = ("compression_scale", "rebound_scale")


def curve_band_of(solution: Solution, error: float) -> CurveBand:
    """Return the band of a solution's static curve over the velocities of its records.

    Args:
        solution: Solution of a fit.
        error: RMS error of the fit on left-out parts [N], which the band contains besides that of the jackknife.
    """
    model = solution.model
    n, inside = model.curve_count, model.runs.velocity[model.runs.inside]
    velocity = np.linspace(inside.min(), inside.max(), _BAND)
    covariance, reach = np.nan_to_num(solution.covariance[:, :n, :n]), quantile(model.runs)
    columns, samples = model.basis.at(velocity), _samples(solution)
    band = curve_band(columns, samples, solution.parameters[:n], covariance, velocity, reach)
    return replace(band, half_width=np.hypot(band.half_width, error))


def factor_half_widths(band: CurveBand) -> dict[str, float]:
    """Return the half-width of the factor on each side that has samples, by the name of the parameter."""
    return {name: half for name, half in zip(_FACTORS, band.factors.tolist(), strict=True) if np.isfinite(half)}


def left_out_blocks(solution: Solution) -> LeftOutBlocks:
    """Return the changes of the law's parameters and of the factors on both sides when each block is left out.

    Runs are taken in the order of their RMS velocity, the fastest first: the order of the tests does not matter.
    """
    model, changes = solution.model, solution.left_out
    n, m, (_, _, theta) = model.curve_count, model.linear_count, model.split(solution.parameters)
    factors = changes[:, :n] @ factor_rows(_samples(solution), solution.parameters[:n]).T
    own = changes[:, m:] @ model.dynamics.values_jacobian(theta).T
    names, columns = (*_FACTORS, *model.dynamics.names), np.hstack([factors, own])
    order = _by_speed(model.runs)
    squares = [np.mean(model.runs.row_velocity[block] ** 2) for block in blocks_of(model.runs)]
    return LeftOutBlocks.of(np.sqrt(squares)[order], dict(zip(names, columns[order].T, strict=True)))


def _samples(solution: Solution) -> Array:
    """Return the columns of the curve at the rows that count."""
    model = solution.model
    return model.basis.at(model.runs.row_velocity[model.runs.weights > 0.0])


def _by_speed(runs: Runs) -> list[int]:
    """Return the blocks (B,) in the order of the RMS velocity of their runs, the fastest run first."""
    ends = np.cumsum([f.rows.size for f in runs.filters])
    squares = np.array([np.mean(part**2) for part in np.split(runs.row_velocity, ends[:-1])])
    numbers = np.searchsorted(ends, [block.start for block in blocks_of(runs)], side="right")
    order: list[int] = np.argsort(-squares[numbers], kind="stable").tolist()
    return order
