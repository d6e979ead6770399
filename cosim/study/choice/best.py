"""Choice among setups under uncertainty: probability of being best, ties, and the most informative tests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr

from cosim.study.choice.certainty import OBJECTIVE, NextTest
from cosim.study.choice.posterior import Posterior, probability_below
from cosim.study.choice.sources import Variables
from cosim.study.table import StudyResult
from eightpost.array_types import Array, Flags, Integers
from eightpost.uncertainty import DEGREES

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
        weights, offset = [result.factor(term) for term in terms], sum(map(result.constant, terms))
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
        middle, student, normal = posterior.moments(posterior.sources.only_measure(one.measure))
        degrees = posterior.degrees(np.array([one.measure]))
        level = predicted[:, one.measure]
        below = [_below(limit, level, middle, student, normal, degrees) for limit in (one.low, one.high)]
        found *= np.clip(below[1] - below[0], 0.0, 1.0)
    return np.where(done, found, 0.0)


def _below(limit: float, level: Array, middle: Array, student: Array, normal: Array, degrees: float) -> Array:
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
        lowest = values[some] == values[some].min(axis=1, keepdims=True)
        winners = (lowest / lowest.sum(axis=1, keepdims=True)).sum(axis=0)  # equal setups share a draw
        best[group % 2] += winners
        among += winners if top == 1 else _among(values, min(top, rows.size))
        apart = levels[:, covered] - middle[covered]
        sums += apart.sum(axis=0)
        products += apart.T @ apart
        none += int(np.count_nonzero(~some))
        total += size
    covariance = products / total - np.outer(sums, sums) / total**2
    return Drawn(rows, best, among / total, total, covariance, covered, none / total)


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
