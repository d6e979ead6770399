"""Estimate of a study's coupling errors from the local errors that the bonds of each run measure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from cosim.session.verdict import Coupled
from eightpost.array_types import Array


class CoupledRun(Protocol):
    """Run with the local errors of its bonds."""

    @property
    def coupled(self) -> Mapping[str, Coupled]:
        """Local errors by bond."""


@dataclass(frozen=True)
class ErrorModel:
    """Gains from the local errors of bond ends to coupling errors."""

    ends: tuple[str, ...]  #: Names of the bond ends with local errors, as `bond.velocity` or `bond.force`.
    #: Gain of each end for each compared channel; the errors are in percent of the channel's scale.
    channels: Mapping[str, tuple[float, ...]]
    #: Gain of each end for each measure; the errors are in the measure's SI unit.
    measures: Mapping[str, tuple[float, ...]]

    def worst_channel(self, result: CoupledRun) -> float:
        """Return the largest estimated error of the compared channels, in percent of the channel's scale."""
        return float(np.sqrt(self._of_channels @ self._squares(result)).max(initial=0.0))

    def of_measures(self, result: CoupledRun) -> dict[str, float]:
        """Return the estimated error of every measure that the pilots had, in its SI unit."""
        return dict(zip(self.measures, np.sqrt(self._of_measures @ self._squares(result)).tolist(), strict=True))

    @cached_property
    def _of_channels(self) -> Array:
        return np.array([*self.channels.values()]).reshape(-1, len(self.ends))

    @cached_property
    def _of_measures(self) -> Array:
        return np.array([*self.measures.values()]).reshape(-1, len(self.ends))

    def _squares(self, result: CoupledRun) -> Array:
        local = local_errors(result)
        return np.array([local[end] for end in self.ends]) ** 2


@dataclass(frozen=True, slots=True)
class Pilot:
    """A run with known coupling errors."""

    result: CoupledRun  #: Run at the study's step.
    channels: Mapping[str, float]  #: Error of each compared channel, in percent of the channel's scale.
    measures: Mapping[str, float]  #: Error of each measure of the run's drive, in its SI unit.


def fit_error_model(pilots: Sequence[Pilot]) -> ErrorModel:
    """Return the gains fitted to the errors of one or more pilots."""
    local = [local_errors(pilot.result) for pilot in pilots]
    ends = tuple(end for end in local[0] if any(one[end] > 0.0 for one in local))
    squares = np.array([[one[end] ** 2 for end in ends] for one in local]).reshape(len(pilots), len(ends))
    measures = dict.fromkeys(name for pilot in pilots for name in pilot.measures)
    return ErrorModel(
        ends,
        channels={n: _gains(squares, [p.channels.get(n) for p in pilots], _middle) for n in pilots[0].channels},
        measures={n: _gains(squares, [p.measures.get(n) for p in pilots], _mean) for n in measures},
    )


def local_errors(result: CoupledRun) -> dict[str, float]:
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
