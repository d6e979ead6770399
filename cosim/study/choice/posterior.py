"""Errors of a study's measures after rig runs: normal variables given the measured levels, and their scales."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import gammaincinv, logsumexp, ndtr, stdtr

from cosim.study.choice.certainty import OBJECTIVE, NextTest
from cosim.study.choice.sources import UNKNOWN, Axes, ErrorSources, Scales, Variables
from cosim.study.table import StudyResult
from eightpost import units
from eightpost.array_types import Array, Flags, Integers
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
    for square in _squared_scales(_middles(_NODES), degrees):
        deviation = np.sqrt(square * student + normal)
        with np.errstate(divide="ignore", invalid="ignore"):
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
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = 2.0 * probability_below(middle, _SHARES, 1.0 - _SHARES, degrees) - 1.0 > probability
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)


# ---- Errors given measured levels -----------------------------------------------------------------------------------

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
        none = np.empty(0, dtype=np.int64)
        return cls(none, none, np.empty(0), np.empty(0))

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
        local = Observations(np.arange(1, seen.rows.size + 1), seen.measures, seen.changes, seen.deviations)
        weights = np.zeros(kept.predicted.shape)
        weights[:, m] = 1.0
        middle, student, normal = Posterior(kept, local).moments(weights)
        return float(middle[0]), float(student[0]), float(normal[0])

    def agreement(self, m: int) -> float:
        """Return the log of the density of a measure's levels relative to that of levels as predicted: 0 or less."""
        _, covariances, changes = self._prior_levels(m)
        as_measured, as_predicted = (_log_likelihood(covariances, one) for one in (changes, np.zeros_like(changes)))
        return float(logsumexp(as_measured) - logsumexp(as_predicted))

    @property
    def _unexplained(self) -> Array:
        """Measured changes beyond the known shift (N,)."""
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
        """Return the covariance (N, N) of the measured levels."""
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


# ==== Choice among setups under uncertainty: probability of being best, ties, and the most informative tests =========

#: Number of groups of draws; the scales of Student's t distributions are the same within a group.
_GROUPS = 64

#: Largest number of setups that are compared by draws, and smallest probability of being better than the k-th best.
CANDIDATES, _LEAST = 2000, 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Criterion:
    """What setups are ranked by: a weighted sum of measures, lowest first."""

    name: str  #: `OBJECTIVE` or the name of a measure.
    measures: Integers  #: Positions of its measures (I,).
    weights: Array  #: Factors of the measures in SI (I,).
    offset: float = 0.0  #: Constant added to the sum.

    @classmethod
    def of(cls, result: StudyResult, name: str) -> Criterion:
        """Return the criterion of a name.

        Raises:
            InputError: There is no such measure.
        """
        names = [measure.name for measure in result.measures]
        if name != OBJECTIVE:
            return cls(name, np.array([names.index(result.study.measure(name).name)]), np.ones(1))
        terms = result.study.objective
        pairs = [units.conversion(result.unit(term.measure), term.unit or result.unit(term.measure)) for term in terms]
        weights = [term.weight * factor for term, (factor, _) in zip(terms, pairs, strict=True)]
        offset = sum(term.weight * constant for term, (_, constant) in zip(terms, pairs, strict=True))
        return cls(name, np.array([names.index(term.measure) for term in terms]), np.array(weights), offset)

    def values(self, levels: Array) -> Array:
        """Return the criterion (...,) of levels of all measures (..., M)."""
        return np.asarray(levels[..., self.measures] @ self.weights + self.offset)

    def changes(self, predicted: Array) -> Array:
        """Return the change of the criterion with the errors of all measures (R, M), at predicted levels (R, M)."""
        found = np.zeros(predicted.shape)
        for m, weight in zip(self.measures.tolist(), self.weights.tolist(), strict=True):
            found[:, m] += weight * np.nan_to_num(predicted[:, m])
        return found


class Limits(NamedTuple):
    """Constraint: position of its measure, and the limits of the level in SI."""

    measure: int
    low: float
    high: float


def limits_of(result: StudyResult) -> tuple[Limits, ...]:
    """Return the constraints of a study."""
    names = [measure.name for measure in result.measures]
    return tuple(Limits(names.index(c.measure), c.at_least, c.at_most) for c in result.study.constraints)


def feasible_probability(posterior: Posterior, limits: Sequence[Limits], done: Flags) -> Array:
    """Return the probability that each setup meets all constraints (R,).

    The errors of different measures are treated as independent.
    """
    predicted = posterior.sources.predicted
    found = np.where(done, 1.0, 0.0)
    for one in limits:
        weights = np.zeros(predicted.shape)
        weights[:, one.measure] = 1.0
        middle, student, normal = posterior.moments(weights)
        degrees = posterior.degrees(np.array([one.measure]))
        level = predicted[:, one.measure]
        below = [_below(limit, level, middle, student, normal, degrees) for limit in (one.low, one.high)]
        found *= np.clip(below[1] - below[0], 0.0, 1.0)
    return np.where(done, found, 0.0)


def _below(limit: float, level: Array, middle: Array, student: Array, normal: Array, degrees: float) -> Array:
    """Return the probability that the true level is below a limit (R,)."""
    if np.isinf(limit):
        return np.full(level.shape, float(limit > 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.where((level > 0.0) & (limit > 0.0), np.log(limit / level), np.where(level < limit, 1e9, -1e9))
    exact = (student + normal == 0.0) & (change == middle)  # a level at the limit meets it
    return np.where(exact, float(limit > 0.0), probability_below(change - middle, student, normal, degrees))


def candidates(posterior: Posterior, criterion: Criterion, feasible: Array, top: int) -> tuple[Integers, float]:
    """Return the rows that may be among the best k setups, and the largest probability of a row that is left out.

    A row is compared with the k-th best predicted feasible one: by the probability that its true value is lower.
    """
    sources = posterior.sources
    changes = criterion.changes(sources.predicted)
    middle, _, normal = posterior.moments(changes)
    expected = criterion.values(sources.predicted) + middle
    rows = np.flatnonzero((feasible > _LEAST) & np.isfinite(expected))
    if not rows.size:
        return rows, 0.0
    sure = rows[feasible[rows] >= 0.5]
    order = (sure if sure.size else rows)[np.argsort(expected[sure if sure.size else rows], kind="stable")]
    leaders = order[[0, min(top, order.size) - 1]]
    chances = []
    for leader in leaders.tolist():
        square = np.zeros(rows.size)
        for m in np.flatnonzero(np.any(changes != 0.0, axis=0)).tolist():
            scale = posterior.scales.typical
            apart = changes[rows, m, None] * sources.positions[rows] - changes[leader, m] * sources.positions[leader]
            square += (sources.own[m] * scale.own[m]) ** 2 * (apart**2 @ sources.directions[m])
            square += (sources.common[m] * scale.common[m] * (changes[rows, m] - changes[leader, m])) ** 2
        deviation = np.sqrt(square + (np.sqrt(normal[rows]) + np.sqrt(normal[leader])) ** 2)
        above = expected[rows] - expected[leader]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(deviation > 0.0, -above / deviation, np.where(above <= 0.0, 1e9, -1e9))
        chances.append(feasible[rows] * stdtr(DEGREES, ratio))
    kept = np.flatnonzero(chances[1] > _LEAST)
    kept = kept[np.argsort(-chances[1][kept], kind="stable")][:CANDIDATES]
    left = np.ones(rows.size, dtype=np.bool_)
    left[kept] = False
    return np.sort(rows[kept]), float(chances[0][left].max(initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """Drawn true values of K setups."""

    rows: Integers  #: Rows of the setups (K,).
    #: Number of draws in which each setup is the best, in the first and the second half of the draws (2, K); setups
    #: with the same value share a draw.
    best: Array
    among: Array  #: Share of the draws in which each setup is among the best k (K,).
    count: int  #: Number of draws.
    covariance: Array  #: Covariance of the criterion (K, K), or of its first rows by `best`.
    covered: Integers
    none: float  #: Share of the draws in which no setup is feasible.

    @property
    def probability(self) -> Array:
        """Probability of being the best (K,)."""
        return np.asarray(self.best.sum(axis=0) / self.count)

    def ties(self, joint: float) -> Integers:
        """Return the positions of the smallest set that contains the best setup with a joint probability.

        The order comes from one half of the draws and the probability from the other half, both ways; the larger number
        of setups counts, so that rare winners of the same draws do not make the set too small.
        """
        found = self.best.sum(axis=0)
        if not found.any():
            return np.empty(0, dtype=np.int64)
        sizes = []
        for first, second in (self.best, self.best[::-1]):
            order = np.lexsort((np.arange(first.size), -first))
            covered = np.cumsum(second[order])
            sizes.append(int(np.searchsorted(covered, joint * covered[-1] * (1.0 - 1e-12))) + 1 if covered[-1] else 1)
        order = np.lexsort((np.arange(found.size), -found))[: max(sizes)]
        return np.asarray(order[found[order] > 0], dtype=np.int64)


#: Largest number of setups whose covariance is computed.
_COVERED = 300


def draw_choice(
    posterior: Posterior,
    criterion: Criterion,
    limits: Sequence[Limits],
    rows: Integers,
    *,
    top: int,
    count: int,
    seed: int,
) -> Drawn:
    """Draw the true values of some setups and compare them.

    Args:
        criterion: Quantity by which setups are ranked.
        limits: Constraints, which hold for the drawn levels.
        rows: Rows of the setups (K,).
    """
    size = max(count // _GROUPS, 2)
    best, among = np.zeros((2, rows.size)), np.zeros(rows.size)
    near = rows.size <= _COVERED
    middle = criterion.values(posterior.sources.predicted)[rows]
    covered = np.arange(rows.size) if near else np.sort(np.argsort(middle, kind="stable")[:_COVERED])
    sums, products, none, total = np.zeros(covered.size), np.zeros((covered.size, covered.size)), 0, 0
    for group, (levels, meets) in enumerate(_groups(posterior, criterion, limits, rows, size, seed)):
        values = np.where(meets, levels, np.inf)
        some = np.isfinite(values).any(axis=1)
        winners = _winners(values[some])
        best[group % 2] += winners
        among += winners if top == 1 else _among(values, min(top, rows.size))
        apart = (levels - middle)[:, covered]
        sums += apart.sum(axis=0)
        products += apart.T @ apart
        none += int(np.count_nonzero(~some))
        total += size
    covariance = products / total - np.outer(sums, sums) / total**2
    return Drawn(rows, best, among / total, total, covariance, covered, none / total)


def _winners(values: Array) -> Array:
    """Return in how many draws each setup has the lowest of the values (D, K); equal setups share a draw."""
    lowest = values == values.min(axis=1, keepdims=True)
    return np.asarray((lowest / lowest.sum(axis=1, keepdims=True)).sum(axis=0))


def _among(values: Array, top: int) -> Integers:
    """Return in how many draws each setup is among the best k, from values (D, K); infinity for infeasible setups."""
    places = np.argpartition(values, top - 1, axis=1)[:, :top]
    found = np.isfinite(np.take_along_axis(values, places, axis=1))
    return np.asarray(np.bincount(places[found], minlength=values.shape[1]), dtype=np.int64)


def _groups(
    posterior: Posterior, criterion: Criterion, limits: Sequence[Limits], rows: Integers, size: int, seed: int
) -> Iterator[tuple[Array, Flags]]:
    """Yield drawn values of the criterion (D, K), and whether they meet the constraints, group by group."""
    generator = np.random.default_rng(seed)
    measures = sorted({*criterion.measures.tolist(), *(one.measure for one in limits)})
    for scales in posterior.scales.groups(_GROUPS, generator):
        drawn = posterior.draw(scales, size, generator)
        levels = {m: drawn_levels(posterior, drawn, rows, m, generator) for m in measures}
        values = criterion.offset + sum(
            weight * levels[m] for m, weight in zip(criterion.measures.tolist(), criterion.weights, strict=True)
        )
        meets = np.ones((size, rows.size), dtype=np.bool_)
        for one in limits:
            meets &= (levels[one.measure] >= one.low) & (levels[one.measure] <= one.high)
        yield np.asarray(values), meets


def drawn_levels(
    posterior: Posterior, drawn: Variables, rows: Integers, m: int, generator: np.random.Generator
) -> Array:
    """Return drawn true levels (D, K) of a measure of K setups, SI."""
    sources = posterior.sources
    errors = sources.errors(drawn, rows, m)
    if np.any(sources.coupling[rows, m]):
        errors += generator.standard_normal(errors.shape) * sources.coupling[rows, m]
    return np.asarray(sources.predicted[rows, m] * np.exp(errors))


# ---- The next tests -------------------------------------------------------------------------------------------------

#: Share of a variance that counts as zero.
_NOTHING = 1e-9


def next_tests(covariance: Array, probability: Array, noise: float, count: int) -> list[tuple[int, float]]:
    """Return the tests that most reduce the uncertainty of the choice, in order.

    The uncertainty is the mean variance of the difference of two setups, each drawn by its probability of being the
    best. A test measures the criterion of one setup. The first two tests are chosen together, because one level alone
    says little about differences; the others follow one by one.

    Args:
        covariance: Covariance of the criterion (K, K).
        probability: Probability of being the best (K,).

    Returns:
        Positions of the setups, with the share of the uncertainty that is expected to remain.
    """
    weight = probability / max(float(probability.sum()), 1e-300)
    whole, size = _spread(covariance, weight), float(covariance.diagonal().max(initial=0.0))
    if not whole > 0.0 or np.count_nonzero(weight) < 2:
        return []
    left, found = covariance, list[tuple[int, float]]()
    for _ in range(min(count, weight.size)):
        gains = _gains(left, weight, noise, size)
        gains[[place for place, _ in found]] = -1.0
        place = int(np.argmax(gains)) if found else _pair(left, weight, noise, size)[0]
        if gains[place] <= _NOTHING * whole and found:
            break
        left = _measured(left, place, noise, size)
        found.append((place, max(_spread(left, weight), 0.0) / whole))
    return found


def _spread(covariance: Array, weight: Array) -> float:
    return float(weight @ covariance.diagonal() - weight @ covariance @ weight)


def _gains(covariance: Array, weight: Array, noise: float, size: float) -> Array:
    """Return the reduction of the spread by each test (K,); a setup that is known exactly gives nothing."""
    variance = covariance.diagonal() + noise
    reduced = weight @ covariance**2 - (weight @ covariance) ** 2
    return np.divide(reduced, variance, out=np.zeros_like(variance), where=variance > _NOTHING * size)


def _measured(covariance: Array, place: int, noise: float, size: float) -> Array:
    column = covariance[:, place]
    variance = float(column[place]) + noise
    return covariance if variance <= _NOTHING * size else np.asarray(covariance - np.outer(column, column) / variance)


def _pair(covariance: Array, weight: Array, noise: float, size: float) -> tuple[int, int]:
    """Return the two tests that together reduce the spread most; first the one that alone reduces it more."""
    alone = _gains(covariance, weight, noise, size)
    best, chosen = -np.inf, (0, 0)
    for place in range(weight.size):
        after = _gains(_measured(covariance, place, noise, size), weight, noise, size)
        after[place] = -1.0
        second = int(np.argmax(after))
        if alone[place] + after[second] > best * (1.0 + 1e-12):
            best, chosen = float(alone[place] + after[second]), (place, second)
    return chosen if alone[chosen[0]] >= alone[chosen[1]] else chosen[::-1]


def tests_of(result: StudyResult, drawn: Drawn, ties: Integers, noise: float, count: int) -> tuple[NextTest, ...]:
    """Return the tests to make next, among the ties."""
    place = {int(p): k for k, p in enumerate(drawn.covered.tolist())}
    kept = [int(p) for p in ties.tolist() if int(p) in place]
    at = [place[p] for p in kept]
    found = next_tests(drawn.covariance[np.ix_(at, at)], drawn.probability[kept], noise, count)
    return tuple(NextTest(int(result.setups[drawn.rows[kept[k]]]), remaining) for k, remaining in found)


# ==== Drawn errors of the vehicle for setups that are not in the table: shocks that nobody has built =================

#: Number of groups of draws with the same scales, and number of draws in each; half of them are the others negated.
_VEHICLE_GROUPS, _PER_GROUP = 64, 4


@dataclass(frozen=True, eq=False)
class VehicleDraws:
    """D drawn errors of M measures, as functions of the levels that the vehicle predicts for a setup.

    ln(true / predicted) = common + own . z,    z: position of the setup
    """

    names: tuple[str, ...]  #: Names of the measures.
    common: Array  #: Common error (D, M).
    own: Array  #: Gradient of the own error (D, M, Z).
    axes: Axes  #: Axes of the positions of setups.
    unknown: tuple[str, ...]  #: Measures whose uncertainty is not known; their errors are 0.

    @classmethod
    def of(cls, result: StudyResult, posterior: Posterior, seed: int = 20270) -> VehicleDraws | None:
        """Return drawn errors; None if the vehicle of the study states no uncertainty."""
        sources = posterior.sources
        generator = np.random.default_rng(seed)
        drawn = [
            posterior.draw(one, _PER_GROUP, generator) for one in posterior.scales.groups(_VEHICLE_GROUPS, generator)
        ]
        parts = drawn if posterior.observations.rows.size else [_balanced(one, sources.shift) for one in drawn]
        unknown = tuple(n for n, origin in zip(sources.names, sources.bases, strict=True) if origin == UNKNOWN)
        common, own = (np.concatenate([getattr(one, part) for one in parts]) for part in ("common", "own"))
        if not np.any(common) and not np.any(own):
            return None
        return cls(sources.names, common, own, Axes.of(result), unknown)

    def levels(self, predicted: Array, measures: Integers) -> Array:
        """Return the true levels (D, K, I) of some measures, SI.

        Args:
            predicted: Predicted levels of all measures of K setups (K, M), SI.
            measures: Positions of the measures (I,).
        """
        places = self.axes.position(predicted)
        errors = self.common[:, None, measures] + np.einsum("diz,kz->dki", self.own[:, measures], places)
        return np.asarray(predicted[:, measures] * np.exp(errors))


def _balanced(drawn: Variables, shift: Array) -> Variables:
    """Return draws of which the second half is the first one negated about the shift, so that this is their mean."""
    half = len(drawn.common) // 2
    parts = (drawn.common - shift, drawn.own, drawn.shocks)
    common, own, shocks = (np.concatenate([part[:half], -part[:half]]) for part in parts)
    return Variables(common + shift, own, shocks)


@dataclass(frozen=True, eq=False)
class DrawnCar:
    """Objective and constraints of setups on D cars that the true one may be, compared with a reference setup.

    An error of the objective that the reference has too, such as a common one, says nothing on which setup is better;
    it is left out of the objective, but not of the constraints.
    """

    draws: VehicleDraws  #: Drawn errors.
    criterion: Criterion  #: Objective.
    limits: tuple[Limits, ...]  #: Constraints.
    reference: Array  #: Predicted levels of the reference (M,), SI.

    @classmethod
    def of(cls, result: StudyResult, draws: VehicleDraws, name: str, row: int) -> DrawnCar:
        """Return the drawn cars of a study.

        Args:
            name: `OBJECTIVE` or the name of a measure.
        """
        reference = np.array([result.values(measure)[row] for measure in draws.names])
        return cls(draws, Criterion.of(result, name), limits_of(result), reference)

    @property
    def is_known(self) -> bool:
        """Whether the uncertainty of every measure of the objective is known."""
        return not self.unknown(self.criterion.measures)

    def unknown(self, measures: Integers) -> tuple[str, ...]:
        """Return those of some measures whose uncertainty is not known."""
        return tuple(self.draws.names[m] for m in measures.tolist() if self.draws.names[m] in self.draws.unknown)

    def objectives(self, predicted: Array) -> Array:
        """Return the objective (K, D) of predicted levels (K, M), less the error that the reference has too."""
        own, reference = (self._objectives(rows) for rows in (predicted, self.reference[None]))
        return own - reference + self.criterion.values(self.reference)

    def limited(self, predicted: Array) -> Sequence[Array]:
        """Return the levels (K, D) of the measure of each constraint."""
        return [self.draws.levels(predicted, np.array([limit.measure]))[..., 0].T for limit in self.limits]

    def _objectives(self, predicted: Array) -> Array:
        levels = self.draws.levels(predicted, self.criterion.measures)
        return np.asarray((levels @ self.criterion.weights + self.criterion.offset).T)
