"""Errors of a study's measures after rig runs: normal variables given the measured levels, and their scales."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import gammaincinv, logsumexp, ndtr

from cosim.study.choice.sources import ErrorSources, Scales, Variables
from eightpost.array_types import Array, Integers
from eightpost.uncertainty import DEGREES

# ---- Sum of a variable with Student's t distribution, a mixture of normal ones, and a normal variable ---------------

#: Number of normal distributions in the mixture.
_NODES = 64
#: Shares of Student's part for which quantiles are tabulated.
_SHARES = np.linspace(0.0, 1.0, 33)


def _squared_scales(probability: Array, degrees: Array | float, factor: Array | float = 1.0) -> Array:
    """Return quantiles of s^2 = factor degrees / chi^2(degrees): N(0, s^2) has a t distribution on average."""
    return np.asarray(factor * degrees / (2.0 * gammaincinv(0.5 * np.asarray(degrees), 1.0 - probability)))


def _middles(count: int) -> Array:
    """Return the middles (count,) of equally probable intervals."""
    return (np.arange(count) + 0.5) / count


def probability_below(value: Array, student: Array, normal: Array, degrees: float) -> Array:
    """Return the probability that the sum is below a value (...,).

    `student` is the squared scale of Student's part (...,), `normal` the variance of the other one (...,).
    """
    total = np.zeros(np.broadcast_shapes(np.shape(value), np.shape(student), np.shape(normal)))
    with np.errstate(divide="ignore", invalid="ignore"):
        for square in _squared_scales(_middles(_NODES), degrees):
            deviation = np.sqrt(square * student + normal)
            total += np.where(deviation > 0.0, ndtr(value / deviation), np.heaviside(value, 0.5))
    return np.asarray(total / _NODES)


def half_width(probability: float, student: Array, normal: Array, degrees: float) -> Array:
    """Return the half-width (...,) of the interval about zero that contains the sum with a probability."""
    whole = student + normal
    share = np.divide(student, whole, out=np.zeros_like(whole), where=whole > 0.0)
    return np.asarray(np.sqrt(whole) * np.interp(share, _SHARES, _reach(probability, degrees)))


@lru_cache(maxsize=64)
def _reach(probability: float, degrees: float) -> Array:
    """Return the half-widths for a sum of size 1 and each tabulated share, by bisection."""
    low, high = np.zeros_like(_SHARES), np.full_like(_SHARES, 1e3)
    deviations = np.sqrt(np.multiply.outer(_squared_scales(_middles(_NODES), degrees), _SHARES) + 1.0 - _SHARES)
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = 2.0 * ndtr(middle / deviations).mean(axis=0) - 1.0 > probability
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)


# ---- Errors given measured levels -----------------------------------------------------------------------------------

#: Number of pairs of scales whose likelihood is compared, and the limits of the degrees of freedom that follow.
_PAIRS, _DEGREES = 512, (DEGREES, 200.0)
#: Smallest standard deviation of a measured level [1]: it keeps equal records from making the covariance singular.
_FLOOR = 1e-6


class Observations(NamedTuple):
    """N measured levels."""

    rows: Integers  #: Rows of the setups (N,).
    measures: Integers  #: Positions of the measures (N,).
    runs: Integers  #: Positions of the rig runs (N,).
    changes: Array  #: ln(measured / predicted) (N,).
    deviations: Array  #: Standard deviations due to run-to-run noise and coupling (N,) [1].

    def only(self, kept: Integers) -> Observations:
        """Return some of the levels."""
        return Observations._make(column[kept] for column in self)


@dataclass(frozen=True, slots=True, eq=False)
class ScaleKnowledge:
    """Distributions of the squared scales of M measures: factor degrees / chi^2(degrees)."""

    factors: Array  #: Factors of the common and own errors (2, M).
    degrees: Array  #: Degrees of freedom (2, M).

    def groups(self, count: int, generator: np.random.Generator) -> list[Scales]:
        """Return equally probable scales, a Latin hypercube over the measures."""
        places = np.stack([generator.permutation(_middles(count)) for _ in range(self.factors.size)], axis=1)
        squares = _squared_scales(places.reshape(count, *self.factors.shape), self.degrees, self.factors)
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
        """Knowledge of the scales: that of the t distribution, updated by the likelihood of the measured levels.

        For each measure, prior pairs of scales are weighted by the likelihood of its own levels. The moments of
        1 / s^2, which has a gamma distribution, give factor and degrees.
        """
        count = len(self.sources.names)
        factors, degrees = np.ones((2, count)), np.full((2, count), DEGREES)
        for m in set(self.observations.measures.tolist()):
            squares, covariances, changes = self._prior_levels(m)
            likelihood = _log_likelihood(covariances, changes)
            weights = np.exp(likelihood - likelihood.max())
            weights /= weights.sum()
            precision = 1.0 / squares
            mean = precision @ weights
            with np.errstate(divide="ignore"):
                found = 2.0 * mean**2 / ((precision - mean[:, None]) ** 2 @ weights)
            factors[:, m], degrees[:, m] = 1.0 / mean, np.clip(found, *_DEGREES)
        return ScaleKnowledge(factors, degrees)

    def draw(self, scales: Scales, count: int, generator: np.random.Generator) -> Variables:
        """Return drawn variables given the measured levels and scales (Matheron's rule)."""
        drawn, seen = self.sources.draw(scales, count, generator), self.observations
        if not seen.rows.size:
            return drawn
        noise = generator.standard_normal((count, seen.rows.size)) * self._deviations
        apart = seen.changes - self._at_levels(drawn) - noise
        weights = cho_solve(cho_factor(self._covariance(scales)), apart.T).T
        levels = self._with_levels(scales)
        own, shocks = (np.tensordot(weights, part, axes=1) for part in (levels.own, levels.shocks))
        return Variables(drawn.common + weights @ levels.common, drawn.own + own, drawn.shocks + shocks)

    def moments(self, weights: Array) -> tuple[Array, Array, Array]:
        """Return the moments of sums of the errors of each setup's measures with weights (R, M).

        Returns:
            Median, squared scale of Student's part and variance of the normal part (R,) each, at the typical scales.
        """
        sources, typical, seen, used = self.sources, self.scales.typical, self.observations, _used(weights)
        rows = np.arange(len(sources.predicted))
        squares, directions = sources.positions**2, sources.directions
        student, normal = np.zeros(rows.size), np.zeros(rows.size)
        for m in used:  # one by one: the arrays of all measures take much memory for many setups
            common, own = sources.common[m] * typical.common[m], sources.own[m] * typical.own[m]
            student += weights[:, m] ** 2 * (common**2 + own**2 * (squares @ directions[m]))
            normal += (weights[:, m] * sources.coupling[:, m]) ** 2
        for place, m in enumerate(used if sources.parameters else ()):
            normal += weights[:, m] ** 2 * sources.shock_covariance(rows, m, m)
            for other in used[:place]:
                normal += 2.0 * weights[:, m] * weights[:, other] * sources.shock_covariance(rows, m, other)
        middle = weights @ sources.shift
        if not seen.rows.size:
            return middle, student, normal
        levels, shared = self._with_levels(typical), np.zeros((seen.rows.size, rows.size))
        for m in used:
            shared += weights[:, m] * sources.errors(levels, rows, m)
        factor = np.linalg.cholesky(self._covariance(typical))
        white = np.linalg.solve(factor, shared)
        middle, whole = middle + white.T @ np.linalg.solve(factor, self._unexplained), student + normal
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
        seen = self.observations
        kept = self.sources.only(np.array([row, *seen.rows.tolist()], dtype=np.int64))
        local = seen._replace(rows=np.arange(1, seen.rows.size + 1))
        middle, student, normal = Posterior(kept, local).moments(kept.only_measure(m))
        return float(middle[0]), float(student[0]), float(normal[0])

    def agreement(self, m: int) -> float:
        """Return the log of the density of a measure's levels relative to that of levels as predicted: 0 or less."""
        _, covariances, changes = self._prior_levels(m)
        as_measured, as_predicted = (_log_likelihood(covariances, one) for one in (changes, np.zeros_like(changes)))
        return float(logsumexp(as_measured) - logsumexp(as_predicted))

    @property
    def _unexplained(self) -> Array:
        return np.asarray(self.observations.changes - self.sources.shift[self.observations.measures])

    @property
    def _deviations(self) -> Array:
        return np.maximum(self.observations.deviations, _FLOOR)

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
        pairs = list(zip(self.observations.rows.tolist(), self.observations.measures.tolist(), strict=True))
        by = (self.sources.by_parameter, self.sources.by_copy)
        fits, copies = (np.array([function(np.array([row]), m)[0] for row, m in pairs]) for function in by)
        return fits, copies

    def _with_levels(self, scales: Scales) -> Variables:
        """Return the covariances of the variables with the errors at the measured levels, as N draws."""
        seen, sources = self.observations, self.sources
        fits, copies = self._changes
        same = seen.measures[:, None] == np.arange(len(sources.names))
        gradient = (sources.own * scales.own)[:, None] ** 2 * sources.directions
        shocks = np.tensordot(fits, sources.changes, axes=1)
        for corner in range(copies.shape[1]):
            shocks[:, corner] += np.tensordot(copies[:, corner], sources.copies[:, corner], axes=1)
        return Variables(
            common=same * (sources.common * scales.common) ** 2 + fits @ sources.shared,
            own=same[:, :, None] * gradient * sources.positions[seen.rows][:, None],
            shocks=shocks,
        )

    def _covariance(self, scales: Scales) -> Array:
        found = self._at_levels(self._with_levels(scales))
        return 0.5 * (found + found.T) + np.diag(self._deviations**2)

    def _prior_levels(self, m: int) -> tuple[Array, Array, Array]:
        """Return prior pairs of squared scales (2, S), covariances (S, N, N) and values (N,) of a measure's levels."""
        own = Posterior(self.sources, self.observations.only(np.flatnonzero(self.observations.measures == m)))
        generator, is_own = np.random.default_rng(m), np.arange(len(self.sources.names)) == m
        squares = _squared_scales(np.stack([generator.permutation(_middles(_PAIRS)) for _ in range(2)]), DEGREES)
        base, common, gradient = (
            own._covariance(Scales(*(np.where(is_own, factor, 0.0) for factor in pair)))
            for pair in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
        )
        first, second = squares[:, :, None, None]
        return squares, base + (0 + first * (common - base) + second * (gradient - base)), own._unexplained


def _used(weights: Array) -> list[int]:
    """Return the positions of the measures that have a weight for any setup."""
    used: list[int] = np.flatnonzero(np.any(weights != 0.0, axis=0)).tolist()
    return used


def _log_likelihood(covariances: Array, changes: Array) -> Array:
    """Return the logarithm of the likelihood (S,) of levels (N,) for covariances (S, N, N), up to a constant."""
    factors = np.linalg.cholesky(covariances)
    white = np.linalg.solve(factors, np.broadcast_to(changes[:, None], (*covariances.shape[:2], 1)))[..., 0]
    return np.asarray(-0.5 * np.sum(white**2, axis=1) - np.sum(np.log(np.diagonal(factors, axis1=1, axis2=2)), axis=1))


# ---- Measured levels that the prediction, its uncertainty and the other rig runs do not explain ---------------------

#: Probability of a deviation below which a measured level contradicts the prediction.
SURPRISING = 0.005
#: Fewest levels of a measure of which one can contradict the others.
_FEWEST = 3


class Surprise(NamedTuple):
    """A measured level that is improbable."""

    position: int  #: Position of the level.
    probability: float  #: Probability of a deviation at least as large.
    used: bool  #: Whether it agrees with the other rig runs, so that it is taken into account.


def surprises_of(sources: ErrorSources, seen: Observations) -> list[Surprise]:
    """Return the measured levels that are improbable.

    A level is compared with the prediction alone, and with the prediction from the other levels of the same measure.
    With three levels or more, a level that the others contradict is left out, one after the other: the one without
    which the others agree best with the prediction. Of two levels that contradict each other, the probability
    of a deviation alone does not say which one is wrong. Levels that agree with each other, but not with the
    prediction, are named and used.
    """
    found = list[Surprise]()
    for m in sorted(set(seen.measures.tolist())):
        kept = np.flatnonzero(seen.measures == m)
        while kept.size >= _FEWEST:
            chances = [_chance(sources, seen, int(k), kept[kept != k]) for k in kept]
            doubtful = [place for place, chance in enumerate(chances) if chance < SURPRISING]
            if not doubtful:
                break
            without = [Posterior(sources, seen.only(np.delete(kept, place))).agreement(m) for place in doubtful]
            worst = doubtful[int(np.argmax(without))]
            found.append(Surprise(int(kept[worst]), chances[worst], used=False))
            kept = np.delete(kept, worst)
        alone = [(int(k), _chance(sources, seen, int(k), kept[:0])) for k in kept]
        found += [Surprise(k, chance, used=True) for k, chance in alone if chance < SURPRISING]
    return found


def _chance(sources: ErrorSources, seen: Observations, position: int, others: Integers) -> float:
    """Return the probability of a level at least as far from its prediction from some of the others."""
    posterior, m = Posterior(sources, seen.only(others)), int(seen.measures[position])
    middle, student, normal = posterior.of_setup(int(seen.rows[position]), m)
    normal += float(seen.deviations[position]) ** 2
    apart = np.array([-abs(float(seen.changes[position]) - middle)])
    below = probability_below(apart, np.array([student]), np.array([normal]), posterior.degrees(np.array([m])))
    return float(2.0 * below[0])
