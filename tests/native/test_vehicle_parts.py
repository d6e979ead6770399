"""The factors of the native vehicle's step are exact at any step, and a state that is too large is detected."""

import ctypes
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

HARNESS = Path(__file__).with_name("vehicle_parts.c")


@pytest.fixture(scope="module")
def parts(compiler, source_folders, tmp_path_factory):
    """Return the internal functions of the seven-DOF car as a shared library."""
    folder = source_folders["seven_dof"]
    others = [str(source) for source in sorted(folder.glob("*.c")) if source.name != "model.c"]
    options = ["-O1", "-fPIC", "-shared", str(HARNESS), *others]
    return ctypes.CDLL(str(compiler(folder, options, tmp_path_factory.mktemp("parts") / "parts.so")))


def reals(*shape):
    """Return an array for C to write to, and its address."""
    array = np.empty(shape)
    return array, array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def eigenvalues(parts):
    (sigma, at), (omega, at_omega) = reals(parts.mode_count()), reals(parts.mode_count())
    parts.eigenvalues(at, at_omega)
    return sigma + 1j * omega


def phi(x, order):
    """Return the sum of x^k / (k + order)!; for large x by the recursion from e^x, which is more accurate there."""
    if abs(x) <= 1.0:
        return sum(x**k / math.factorial(k + order) for k in reversed(range(25)))
    return np.exp(x) if order == 0 else (phi(x, order - 1) - 1.0) / x


@pytest.mark.parametrize("h", [1e-7, 1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 0.03, 0.1, 0.3, 1.0, 10.0])
def test_the_factors_of_a_step_are_exact_at_any_step(parts, h):
    """e^x, h (phi1 - phi2) and h phi2, to 64 roundings: each of up to six doublings doubles the rounding error."""
    poles = eigenvalues(parts)
    factors, at = reals(6, poles.size)
    parts.factors_of_step(ctypes.c_double(h), at)
    growth, one, two = (np.array([phi(x, order) for x in poles * h]) for order in range(3))
    tolerance = 64.0 * np.finfo(float).eps
    np.testing.assert_allclose(factors[0] + 1j * factors[1], growth, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose((factors[4] + 1j * factors[5]) / h, two, rtol=tolerance)
    np.testing.assert_allclose((factors[2] + 1j * factors[3]) / h, one - two, rtol=tolerance)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(0.0, 30.0), st.floats(0.5 * math.pi, 1.5 * math.pi))
def test_the_exponentials_of_a_damped_mode_are_exact_in_both_forms(parts, size, angle):
    x = size * complex(math.cos(angle), math.sin(angle))
    expected = [phi(x, order) for order in range(3)]
    doublings = max(0, math.ceil(math.log2(2.0 * size))) if size > 0.5 else 0
    for way in (-1, doublings):
        found, at = reals(6)
        parts.exponentials_of(ctypes.c_double(x.real), ctypes.c_double(x.imag), way, at)
        np.testing.assert_allclose(found[::2] + 1j * found[1::2], expected, rtol=1e-13, atol=1e-14)


def test_a_state_value_that_is_too_large_is_detected_at_every_position(parts):
    parts.is_sound_with.argtypes = [ctypes.c_int, ctypes.c_double]
    places = range(parts.state_count())
    assert all(parts.is_sound_with(k, 0.9e150) for k in places)
    for large in (1.1e150, -1.1e150, math.inf, math.nan):
        assert not any(parts.is_sound_with(k, large) for k in places)


def test_the_number_of_sub_steps_is_rounded_up(parts):
    parts.rounded_up.argtypes = [ctypes.c_double]
    assert [parts.rounded_up(count) for count in (0.0, 0.4, 1.0, 1.1, 2.0, 2.9, 99999.5)] == [1, 1, 1, 2, 2, 3, 100000]


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
