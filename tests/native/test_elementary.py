"""The elementary functions of the C core agree with Python's to a few roundings over their whole range."""

import ctypes
import math
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
EPSILON = np.finfo(float).eps


@pytest.fixture
def library(elementary):
    """Return the functions as a shared library."""
    return elementary


def sine_and_cosine(library, x):
    sine, cosine = ctypes.c_double(), ctypes.c_double()
    library.sine_and_cosine(x, sine, cosine)
    return sine.value, cosine.value


def signed(*ranges):
    """Return random numbers of both signs, of every size between powers of ten."""
    rng = np.random.default_rng(0)
    sizes = np.concatenate([10.0 ** rng.uniform(low, high, 1500) for low, high in ranges])
    return [*sizes.tolist(), *(-sizes).tolist()]


def worst(function, reference, numbers):
    """Return the largest error in units of the rounding of the reference."""
    return max(abs(function(x) - reference(x)) / (EPSILON * abs(reference(x))) for x in numbers)


def test_the_exponential_is_accurate_to_a_few_roundings(library):
    numbers = [x for x in signed((-9, 2.84)) if x > -690.0]
    numbers += [0.0, 1.0, 0.5 * math.log(2.0), -699.0, 708.9, 709.1, 709.5, 709.7, 709.75]
    assert worst(library.exponential, math.exp, numbers) < 4.0


def test_the_exponential_minus_one_is_accurate_for_small_numbers(library):
    numbers = [x for x in signed((-300, 0), (-3, 2.84)) if x < 700.0]
    assert worst(library.exponential_minus_1, math.expm1, numbers) < 6.0
    assert library.exponential_minus_1(0.0) == 0.0


def test_the_exponential_overflows_to_infinity_and_underflows_to_zero(library):
    assert library.exponential(709.79) == library.exponential(1e9) == library.exponential(math.inf) == math.inf
    assert library.exponential(-701.0) == library.exponential(-math.inf) == 0.0
    assert library.exponential_minus_1(-701.0) == library.exponential_minus_1(-math.inf) == -1.0
    assert library.exponential_minus_1(math.inf) == math.inf
    assert math.isnan(library.exponential(math.nan))
    assert math.isnan(library.exponential_minus_1(math.nan))


def test_the_logarithm_is_accurate_to_a_few_roundings(library):
    numbers = [x for x in signed((-300, 300), (-1, 1)) if x > 0.0]
    assert worst(library.logarithm, math.log, [x for x in numbers if x != 1.0]) < 4.0
    assert worst(library.logarithm, math.log, [1.0 + x for x in signed((-14, -1))]) < 4.0
    assert library.logarithm(1.0) == 0.0


def test_the_hyperbolic_tangent_is_accurate_odd_and_saturates_at_one(library):
    numbers = signed((-300, -3), (-3, 1.5))
    assert worst(library.hyperbolic_tangent, math.tanh, numbers) < 6.0
    assert all(library.hyperbolic_tangent(-x) == -library.hyperbolic_tangent(x) for x in numbers)
    assert library.hyperbolic_tangent(0.0) == 0.0
    assert library.hyperbolic_tangent(22.0) == library.hyperbolic_tangent(math.inf) == 1.0
    assert library.hyperbolic_tangent(-1e300) == -1.0


@pytest.mark.parametrize("highest", [0, 3, 6])
def test_sine_and_cosine_are_accurate_to_a_few_roundings_of_one_up_to_a_million(library, highest):
    """The error includes the rounding of the angle, which the reference shares."""
    for x in (0.0, math.pi / 4, math.pi / 2, math.pi, *signed((-9, highest))):
        sine, cosine = sine_and_cosine(library, x)
        assert sine == pytest.approx(math.sin(x), abs=2.0 * EPSILON)
        assert cosine == pytest.approx(math.cos(x), abs=2.0 * EPSILON)


def test_the_sine_of_a_small_angle_has_full_relative_accuracy(library):
    assert worst(lambda x: sine_and_cosine(library, x)[0], math.sin, signed((-300, -0.2))) < 2.0


def test_sine_and_cosine_of_large_angles_are_accurate_to_the_rounding_of_the_angle(library):
    for x in signed((6.1, 14.9)):
        assert sine_and_cosine(library, x) == pytest.approx((math.sin(x), math.cos(x)), abs=4.0 * EPSILON * abs(x))
    for x in (1e15, -1e300, math.inf, -math.inf):
        assert sine_and_cosine(library, x) == (0.0, 1.0)
    assert np.isnan(sine_and_cosine(library, math.nan)).all()
