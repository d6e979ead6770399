"""Errors of a study's measures after rig runs: normal variables given the measured levels, and their scales."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from cosim.study.certainty.mixture import half_width, inverse_gamma, middle_probabilities
from cosim.study.certainty.sources import ErrorSources, Scales, Variables
from eightpost.array_types import Array, Integers
from eightpost.measure_uncertainty import DEGREES

#: Number of pairs of scales whose likelihood is compared, and the limits of the degrees of freedom that follow.
_PAIRS, _DEGREES = 512, (DEGREES, 200.0)

#: Smallest standard deviation of a measured level [1]: it keeps equal records from making the covariance singular.
_FLOOR = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """N measured levels."""

    rows: Integers  #: Rows of the setups (N,).
    measures: Integers  #: Positions of the measures (N,).
    changes: Array  #: ln(measured / predicted) (N,).
    deviations: Array  #: Standard deviations due to run-to-run noise and coupling (N,) [1].
    files: tuple[str, ...] = ()  #: Names of the records.

    @classmethod
    def none(cls) -> Observations:
        """Return no levels."""
        empty = np.empty(0)
        return cls(empty.astype(np.int64), empty.astype(np.int64), empty, empty)

    def only(self, kept: Integers) -> Observations:
        """Return some of the levels."""
        files = tuple(self.files[k] for k in kept.tolist()) if self.files else ()
        return Observations(self.rows[kept], self.measures[kept], self.changes[kept], self.deviations[kept], files)


@dataclass(frozen=True, slots=True, eq=False)
class ScaleKnowledge:
    """Distributions of the squared scales of M measures: factor degrees / chi^2(degrees)."""

    factors: Array  #: Factors of the common and own errors (2, M).
    degrees: Array  #: Degrees of freedom (2, M).

    def groups(self, count: int, generator: np.random.Generator) -> list[Scales]:
        """Return equally probable scales, a Latin hypercube over the measures."""
        middles = middle_probabilities(count)
        shape = self.factors.shape
        places = np.stack([generator.permutation(middles) for _ in range(self.factors.size)], axis=1)
        squares = inverse_gamma(places.reshape(count, *shape), self.degrees, self.factors)
        return [Scales(*np.sqrt(row)) for row in squares]

    @property
    def typical(self) -> Scales:
        """Scales at which a normal distribution has the parameters of the t distribution."""
        return Scales(*np.sqrt(self.factors))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Errors of R setups given N measured levels."""

    sources: ErrorSources  #: Sources of the errors.
    observations: Observations  #: Measured levels.

    @cached_property
    def scales(self) -> ScaleKnowledge:
        """Knowledge of the scales: that of the t distribution, updated by the likelihood of the measured levels."""
        count = len(self.sources.names)
        factors, degrees = np.ones((2, count)), np.full((2, count), DEGREES)
        for m in set(self.observations.measures.tolist()):
            factors[:, m], degrees[:, m] = self._scales_of(m)
        return ScaleKnowledge(factors, degrees)

    def draw(self, scales: Scales, count: int, generator: np.random.Generator) -> Variables:
        """Return drawn variables given the measured levels and scales (Matheron's rule)."""
        drawn, seen = self.sources.draw(scales, count, generator), self.observations
        if not seen.rows.size:
            return drawn
        noise = generator.standard_normal((count, seen.rows.size)) * self._deviations
        apart = seen.changes - self._at_levels(drawn) - noise
        weights = cho_solve(cho_factor(self._covariance(scales)), apart.T).T
        with_levels = self._with_levels(scales)
        return Variables(
            drawn.common + weights @ with_levels.common,
            drawn.own + np.tensordot(weights, with_levels.own, axes=1),
            drawn.shocks + np.tensordot(weights, with_levels.shocks, axes=1),
        )

    def moments(self, weights: Array) -> tuple[Array, Array, Array]:
        """Return the moments of weighted sums of the errors of each setup's measures.

        Args:
            weights: Weight of each measure for each setup (R, M).

        Returns:
            Median, squared scale of Student's part and variance of the normal part (R,) each, at the typical scales.
        """
        sources, typical = self.sources, self.scales.typical
        rows = np.arange(len(sources.predicted))
        squares, directions = sources.positions**2, sources.directions
        student = np.zeros(rows.size)
        for m in _used(weights):  # one by one: the arrays of all measures take much memory for many setups
            common, own = sources.common[m] * typical.common[m], sources.own[m] * typical.own[m]
            student += weights[:, m] ** 2 * (common**2 + own**2 * (squares @ directions[m]))
        normal = self._normal(weights, rows)
        known = weights @ sources.shift
        if not self.observations.rows.size:
            return known, student, normal
        with_levels = self._with_levels(typical)
        shared = np.zeros((self.observations.rows.size, rows.size))
        for m in _used(weights):
            shared += weights[:, m] * sources.errors(with_levels, rows, m)
        factor = np.linalg.cholesky(self._covariance(typical))
        white = np.linalg.solve(factor, shared)
        middle = known + white.T @ np.linalg.solve(factor, self._unexplained)
        whole = student + normal
        left = np.clip(1.0 - np.sum(white**2, axis=0) / np.where(whole > 0.0, whole, 1.0), 0.0, 1.0)
        return np.asarray(middle), student * left, normal * left

    def degrees(self, measures: Integers) -> float:
        """Return the degrees of freedom of weighted sums of some measures: the smallest."""
        return float(self.scales.degrees[:, measures].min()) if measures.size else DEGREES

    def half_widths(self, probabilities: tuple[float, ...], weights: Array) -> tuple[Array, Array]:
        """Return medians (R,) and half-widths of intervals (P, R) of weighted sums of the errors; see `moments`."""
        middle, student, normal = self.moments(weights)
        degrees = self.degrees(np.array(_used(weights), dtype=np.int64))
        return middle, np.stack([half_width(p, student, normal, degrees) for p in probabilities])

    def of_setup(self, row: int, m: int) -> tuple[float, float, float]:
        """Return the moments of the error of one measure of one setup; see `moments`."""
        kept = self.sources.only(np.array([row, *self.observations.rows.tolist()], dtype=np.int64))
        seen = self.observations
        local = Observations(np.arange(1, seen.rows.size + 1), seen.measures, seen.changes, seen.deviations)
        weights = np.zeros(kept.predicted.shape)
        weights[:, m] = 1.0
        first = (float(part[0]) for part in Posterior(kept, local).moments(weights))
        return next(first), next(first), next(first)

    @property
    def _unexplained(self) -> Array:
        """Measured changes beyond the known shift (N,)."""
        return np.asarray(self.observations.changes - self.sources.shift[self.observations.measures])

    @property
    def _deviations(self) -> Array:
        return np.maximum(self.observations.deviations, _FLOOR)

    def _normal(self, weights: Array, rows: Integers) -> Array:
        """Return the variance (R,) of the normal part of weighted sums of the errors."""
        sources = self.sources
        used = _used(weights)
        found = np.zeros(rows.size)
        for m in used:
            found += (weights[:, m] * sources.coupling[:, m]) ** 2
        if not sources.parameters:
            return found
        for place, m in enumerate(used):
            found += weights[:, m] ** 2 * sources.shock_covariance(rows, m, m)
            for other in used[:place]:
                found += 2.0 * weights[:, m] * weights[:, other] * sources.shock_covariance(rows, m, other)
        return np.asarray(found)

    def _at_levels(self, drawn: Variables) -> Array:
        """Return the errors (D, N) at the measured levels."""
        seen = self.observations
        found = np.empty((len(drawn.common), seen.rows.size))
        for m in set(seen.measures.tolist()):
            own = seen.measures == m
            found[:, own] = self.sources.errors(drawn, seen.rows[own], m)
        return found

    @cached_property
    def _changes(self) -> tuple[Array, Array]:
        """Changes at the measured levels by a standard deviation of each mode (N, F) and copy (N, C, P)."""
        seen, sources = self.observations, self.sources
        pairs = list(zip(seen.rows.tolist(), seen.measures.tolist(), strict=True))
        fits = [sources.by_parameter(np.array([row]), m)[0] for row, m in pairs]
        copies = [sources.by_copy(np.array([row]), m)[0] for row, m in pairs]
        return np.array(fits), np.array(copies)

    def _with_levels(self, scales: Scales) -> Variables:
        """Return the covariances of the variables with the errors at the measured levels, as N draws."""
        seen, sources = self.observations, self.sources
        fits, copies = self._changes
        same = seen.measures[:, None] == np.arange(len(sources.names))
        common = same * (sources.common * scales.common) ** 2 + fits @ sources.shared
        gradient = (sources.own * scales.own)[:, None] ** 2 * sources.directions
        own = same[:, :, None] * gradient * sources.positions[seen.rows][:, None]
        shocks = np.tensordot(fits, sources.changes, axes=1)
        for corner in range(copies.shape[1]):
            shocks[:, corner] += np.tensordot(copies[:, corner], sources.copies[:, corner], axes=1)
        return Variables(common, own, shocks)

    def _covariance(self, scales: Scales) -> Array:
        """Return the covariance (N, N) of the measured levels."""
        found = self._at_levels(self._with_levels(scales))
        return 0.5 * (found + found.T) + np.diag(self._deviations**2)

    def _scales_of(self, m: int) -> tuple[Array, Array]:
        """Return factors (2,) and degrees (2,) of the squared scales of a measure, from its own measured levels.

        Prior pairs of scales are weighted by the likelihood of the levels. The moments of 1 / s^2, which has a gamma
        distribution, give factor and degrees.
        """
        squares, covariances, changes = self._prior_levels(m)
        likelihood = _log_likelihood(covariances, changes)
        weights = np.exp(likelihood - likelihood.max())
        weights /= weights.sum()
        precision = 1.0 / squares
        mean = precision @ weights
        variance = (precision - mean[:, None]) ** 2 @ weights
        with np.errstate(divide="ignore"):
            degrees = np.clip(2.0 * mean**2 / variance, *_DEGREES)
        return 1.0 / mean, degrees

    def agreement(self, m: int) -> float:
        """Return how well the measured levels of a measure agree with the prediction: 0 or less.

        It is the logarithm of their probability density relative to that of levels as predicted.
        """
        _, covariances, changes = self._prior_levels(m)
        as_measured, as_predicted = (_log_likelihood(covariances, one) for one in (changes, np.zeros_like(changes)))
        return float(logsumexp(as_measured) - logsumexp(as_predicted))

    def _prior_levels(self, m: int) -> tuple[Array, Array, Array]:
        """Return prior pairs of squared scales (2, S), covariances (S, N, N) and values (N,) of a measure's levels."""
        own = Posterior(self.sources, self.observations.only(np.flatnonzero(self.observations.measures == m)))
        generator = np.random.default_rng(m)
        middles = middle_probabilities(_PAIRS)
        squares = inverse_gamma(np.stack([generator.permutation(middles) for _ in range(2)]), DEGREES)
        base = [
            own._covariance_of(m, Scales(np.array(a), np.array(b))) for a, b in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
        ]
        covariances = base[0] + sum(squares[k][:, None, None] * (base[k + 1] - base[0]) for k in range(2))
        return squares, covariances, own._unexplained

    def _covariance_of(self, m: int, factors: Scales) -> Array:
        """Return the covariance of levels of one measure only, for factors of its scales."""
        count = len(self.sources.names)
        scales = Scales(*(np.where(np.arange(count) == m, factor, 0.0) for factor in factors))
        return self._covariance(scales)


def _used(weights: Array) -> list[int]:
    """Return the positions of the measures that have a weight for any setup."""
    used: list[int] = np.flatnonzero(np.any(weights != 0.0, axis=0)).tolist()
    return used


def _log_likelihood(covariances: Array, changes: Array) -> Array:
    """Return the logarithm of the likelihood (S,) of levels (N,) for covariances (S, N, N), up to a constant."""
    factors = np.linalg.cholesky(covariances)
    white = np.linalg.solve(factors, np.broadcast_to(changes[:, None], (*covariances.shape[:2], 1)))[..., 0]
    return np.asarray(-0.5 * np.sum(white**2, axis=1) - np.sum(np.log(np.diagonal(factors, axis1=1, axis2=2)), axis=1))
