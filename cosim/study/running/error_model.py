"""Estimate of coupling errors from the local errors that the bonds of each run measure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import mul
from typing import Any, NamedTuple

import numpy as np

from cosim.session.result import Result
from eightpost.array_types import Array


@dataclass(frozen=True)
class ErrorModel:
    """Gains from the local errors of bond ends to coupling errors."""

    ends: tuple[str, ...]  #: Names of the bond ends with local errors, as `bond.velocity` or `bond.force`.
    #: Gain of each end for each compared channel; the errors are in percent of the channel's scale.
    channels: Mapping[str, tuple[float, ...]]
    #: Gain of each end for each measure; the errors are in the measure's SI unit.
    measures: Mapping[str, tuple[float, ...]]

    def of(self, local: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Return the estimated errors of one run, or of n runs.

        Args:
            local: Local error of each bond end, in SI (n,).

        Returns:
            Largest error of the compared channels, in percent of the channel's scale (n,); and the error of every
            measure that the pilots had, in its SI unit (n,).
        """
        channels, measures = (self._estimated(table, local) for table in (self.channels, self.measures))
        return np.max([*channels.values()], axis=0, initial=0.0), measures

    def _estimated(self, gains: Mapping[str, tuple[float, ...]], local: Mapping[str, Any]) -> dict[str, Any]:
        squares = [local[end] ** 2 for end in self.ends]
        nothing = np.zeros(np.shape(next(iter(local.values()), 0.0)))
        return {name: np.sqrt(sum(map(mul, row, squares), nothing)) for name, row in gains.items()}


class Pilot(NamedTuple):
    """A run at the study's step, with known coupling errors."""

    local: Mapping[str, float]  #: Local error of each bond end, in SI.
    channels: Mapping[str, float]  #: Error of each compared channel, in percent of the channel's scale.
    measures: Mapping[str, float]  #: Error of each measure of the run's drive, in its SI unit.


def fit_error_model(pilots: Sequence[Pilot]) -> ErrorModel:
    """Return the gains fitted to the errors of one or more pilots."""
    local = [pilot.local for pilot in pilots]
    ends = tuple(end for end in local[0] if any(one[end] > 0.0 for one in local))
    squares = np.array([[one[end] ** 2 for end in ends] for one in local]).reshape(len(pilots), len(ends))
    measures = dict.fromkeys(name for pilot in pilots for name in pilot.measures)
    return ErrorModel(
        ends,
        channels={n: _gains(squares, [p.channels.get(n) for p in pilots], _middle) for n in pilots[0].channels},
        measures={n: _gains(squares, [p.measures.get(n) for p in pilots], _mean) for n in measures},
    )


def local_errors(result: Result) -> dict[str, float]:
    """Return the local error of every bond end of a run, in SI."""
    found: dict[str, float] = {}
    for bond, coupled in result.coupled.items():
        found |= {f"{bond}.velocity": coupled.velocity_error, f"{bond}.force": coupled.force_error}
    return found


def _gains(
    squares: Array, errors: Sequence[float | None], excess: Callable[[Array, Array], float]
) -> tuple[float, ...]:
    """Return the gains (E,) fitted to the pilots that have the error; zeros if it is zero for all.

    `excess` returns the factor by which the fitted squares are too large; the gains are divided by it.
    """
    from scipy.optimize import nnls  # noqa: PLC0415 -- only the process that chooses the coupling needs it

    known = np.array([error is not None for error in errors])
    known_squares = np.array([float(error) ** 2 for error in errors if error is not None])
    if not known_squares.any() or squares.shape[1] == 0:
        return tuple(0.0 for _ in range(squares.shape[1]))
    rows = squares[known]
    sizes = rows.mean(axis=0)  # of order 1, for the solver
    gains = np.asarray(
        nnls(rows / sizes, known_squares / known_squares.mean())[0] * known_squares.mean() / sizes, dtype=np.float64
    )
    return tuple((gains / excess(rows @ gains, known_squares)).tolist())


def _middle(estimated: Array, known_squares: Array) -> float:
    """Return the factor that balances the largest over- and underestimate of the errors of channels."""
    usual = known_squares > 1e-2 * known_squares.mean()
    ratios = estimated[usual] / known_squares[usual]
    return float(np.sqrt(ratios.min() * ratios.max())) if ratios.min() > 0.0 else 1.0


def _mean(estimated: Array, known_squares: Array) -> float:
    """Return the factor of the mean squares; the errors of measures change sign, and may be zero by chance."""
    return float(estimated.mean() / known_squares.mean()) or 1.0
