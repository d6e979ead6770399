"""The low-pass has the gain of its formula and zero phase; the derivative is the central difference."""

import numpy as np
import pytest

from eightpost.signals import derivative, lowpass, velocity_from_displacement

RATE = 2000.0
TIME = np.arange(8000) / RATE
MIDDLE = slice(2000, 6000)


@pytest.mark.parametrize("frequency", [10.0, 40.0, 50.0, 60.0, 100.0])
def test_the_gain_is_that_of_butterworth_squared_and_the_phase_is_zero(frequency):
    wave = np.exp(2j * np.pi * frequency * TIME)
    gain = ((lowpass(wave.real, RATE, 50.0) + 1j * lowpass(wave.imag, RATE, 50.0)) / wave)[MIDDLE]
    # The bilinear transform's frequency, then 1 / (1 + (f / fc)^16).
    warped = np.tan(np.pi * frequency / RATE) / np.tan(np.pi * 50.0 / RATE)
    np.testing.assert_allclose(gain, 1.0 / (1.0 + warped**16), atol=1e-5)


@pytest.mark.parametrize("cutoff", [50.0, 60.0, 0.0, -1.0])
def test_a_cut_off_above_half_the_sample_rate_is_refused(cutoff):
    with pytest.raises(ValueError, match="between 0 and 50 Hz"):
        lowpass(np.zeros(100), 100.0, cutoff)


def test_the_derivative_of_a_parabola_is_exact_inside_and_one_sided_at_the_ends():
    np.testing.assert_allclose(derivative(np.arange(5.0) ** 2, 1.0), [1.0, 2.0, 4.0, 6.0, 7.0])


def test_channels_are_filtered_independently():
    pair = np.stack([np.sin(20.0 * TIME), np.cos(30.0 * TIME)])
    np.testing.assert_allclose(lowpass(pair, RATE, 50.0)[1], lowpass(pair[1], RATE, 50.0))


def test_a_velocity_is_recovered_from_a_noisy_displacement():
    noise = 1e-6 * np.random.default_rng(1).standard_normal(TIME.size)
    velocity = velocity_from_displacement(0.01 * np.sin(2 * np.pi * 3.0 * TIME) + noise, RATE, 50.0)
    exact = 0.01 * 2 * np.pi * 3.0 * np.cos(2 * np.pi * 3.0 * TIME)
    assert np.sqrt(np.mean((velocity - exact)[MIDDLE] ** 2)) < 1e-3 * np.std(exact)


def test_a_record_that_ends_where_it_crosses_its_middle_is_filtered_to_its_ends():
    """The record is continued by its reflection in its ends, which is exact here, for longer than the filter rings."""
    velocity = velocity_from_displacement(0.01 * np.sin(2 * np.pi * 3.0 * TIME), RATE, 50.0)
    exact = 0.01 * 2 * np.pi * 3.0 * np.cos(2 * np.pi * 3.0 * TIME)
    ends = np.r_[0:200, -200:0]
    assert np.abs(velocity - exact)[ends].max() < 2e-3 * np.std(exact)  # 0.88 with a thirtieth of the padding
