"""Sum of a variable with Student's t distribution and a normal one: quantiles and probabilities."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import gammaincinv, ndtr

from eightpost.array_types import Array

#: Number of scales that represent Student's t distribution as a mixture of normal ones.
NODES = 64

#: Shares of Student's part for which quantiles are tabulated.
_SHARES = np.linspace(0.0, 1.0, 33)


def inverse_gamma(probability: Array, degrees: Array | float, factor: Array | float = 1.0) -> Array:
    """Return quantiles of the squared scale of a normal distribution that is a t distribution on average.

        s^2 = factor degrees / chi^2(degrees)

    Args:
        probability: Probabilities, between 0 and 1.
        degrees: Degrees of freedom.
        factor: Factor of the squared scale.
    """
    return np.asarray(factor * degrees / (2.0 * gammaincinv(0.5 * np.asarray(degrees), 1.0 - probability)))


def middle_probabilities(count: int = NODES) -> Array:
    """Return the middles (count,) of equally probable intervals."""
    return (np.arange(count) + 0.5) / count


def probability_below(value: Array, student: Array, normal: Array, degrees: float) -> Array:
    """Return the probability that the sum is below a value (...,).

    Args:
        value: Value (...,).
        student: Squared scale of Student's part (...,).
        normal: Variance of the normal part (...,).
        degrees: Degrees of freedom.
    """
    total = np.zeros(np.broadcast_shapes(np.shape(value), np.shape(student), np.shape(normal)))
    for square in inverse_gamma(middle_probabilities(), degrees):
        deviation = np.sqrt(square * student + normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            total += np.where(deviation > 0.0, ndtr(value / deviation), np.heaviside(value, 0.5))
    return np.asarray(total / NODES)


def half_width(probability: float, student: Array, normal: Array, degrees: float) -> Array:
    """Return the half-width (...,) of the interval about zero that contains the sum with a probability.

    Arguments as in `probability_below`.
    """
    whole = student + normal
    share = np.divide(student, whole, out=np.zeros_like(whole), where=whole > 0.0)
    return np.asarray(np.sqrt(whole) * np.interp(share, _SHARES, _reach(probability, degrees)))


@lru_cache(maxsize=64)
def _reach(probability: float, degrees: float) -> Array:
    """Return the half-widths for a sum of size 1 and each tabulated share of Student's part, by bisection."""
    low, high = np.zeros_like(_SHARES), np.full_like(_SHARES, 1e3)
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = 2.0 * probability_below(middle, _SHARES, 1.0 - _SHARES, degrees) - 1.0 > probability
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)
