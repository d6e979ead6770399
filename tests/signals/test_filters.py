"""The low-pass has the gain of its formula and zero phase; the derivative is the central difference."""

import numpy as np
import pytest
import scipy.signal

from eightpost.signals import derivative, lowpass, velocity_from_displacement
from eightpost.signals.filters import recursion

RATE = 2000.0
TIME = np.arange(8000) / RATE
MIDDLE = slice(2000, 6000)


@pytest.mark.parametrize(
    ("count", "rate", "cutoff", "order"),
    [(3000, 300.0, 50.0, 8), (3000, 20.0, 0.25, 8), (500, 100.0, 10.0, 2), (300, 1e4, 50.0, 8), (2, 9.0, 1.0, 4)],
)
def test_the_low_pass_is_that_of_scipy_to_rounding(count, rate, cutoff, order):
    values = 100.0 + np.cumsum(np.random.default_rng(3).standard_normal((2, 3, count)), axis=-1)
    pad = min(count - 1, int(np.ceil(3 * order * rate / cutoff)))
    exact = scipy.signal.sosfiltfilt(scipy.signal.butter(order, cutoff, fs=rate, output="sos"), values, padlen=pad)
    np.testing.assert_allclose(lowpass(values, rate, cutoff, order=order), exact, rtol=1e-9)


@pytest.mark.parametrize("feedback", [[-0.9], [-1.6, 0.7], [0.2, -0.3, 0.1]])
def test_a_recursion_is_a_filter_that_starts_at_rest(feedback):
    values = np.random.default_rng(4).standard_normal((3, 50))
    given = values.copy()
    np.testing.assert_allclose(recursion(values, feedback), scipy.signal.lfilter([1.0], [1.0, *feedback], given))
    np.testing.assert_array_equal(values, given)


@pytest.mark.parametrize("cutoff", [50.0, 60.0, 0.0, -1.0])
def test_a_cut_off_above_half_the_sample_rate_is_refused(cutoff):
    with pytest.raises(ValueError, match="between 0 and 50 Hz"):
        lowpass(np.zeros(100), 100.0, cutoff)


def test_the_derivative_of_a_parabola_is_exact_inside_and_one_sided_at_the_ends():
    np.testing.assert_allclose(derivative(np.arange(5.0) ** 2, 1.0), [1.0, 2.0, 4.0, 6.0, 7.0])


def test_a_velocity_is_recovered_from_a_noisy_displacement():
    noise = 1e-6 * np.random.default_rng(1).standard_normal(TIME.size)
    velocity = velocity_from_displacement(0.01 * np.sin(2 * np.pi * 3.0 * TIME) + noise, RATE, 50.0)
    exact = 0.01 * 2 * np.pi * 3.0 * np.cos(2 * np.pi * 3.0 * TIME)
    assert np.sqrt(np.mean((velocity - exact)[MIDDLE] ** 2)) < 1e-3 * np.std(exact)


def test_the_velocity_is_right_to_the_ends_of_a_record():
    """The record begins and ends where a sine passes zero, so that its reflection continues it exactly."""
    velocity = velocity_from_displacement(0.01 * np.sin(2 * np.pi * 3.0 * TIME), RATE, 50.0)
    exact = 0.01 * 2 * np.pi * 3.0 * np.cos(2 * np.pi * 3.0 * TIME)
    assert np.abs(velocity - exact).max() < 1e-3 * np.abs(exact).max()
