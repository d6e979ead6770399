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
