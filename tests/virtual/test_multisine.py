"""The dynamometer's multisine is that of Table 3.2 and Eq 3.26."""

import numpy as np
import pytest

from eightpost.virtual.dynamometer import TABLE_3_2, crest_factor, multisine_spectrum, random_multisine


def test_the_spectrum_has_the_lines_of_table_3_2_every_tenth_of_a_hertz():
    drivefile = random_multisine(3, rate=500.0)
    lines = np.abs(np.fft.rfft(drivefile.series["displacement"][:5000]))
    relative = lines / lines[1]
    for frequency, amplitude in TABLE_3_2:
        assert relative[round(10.0 * frequency)] == pytest.approx(amplitude, abs=1e-9)
    frequencies, amplitudes = multisine_spectrum()
    np.testing.assert_allclose(frequencies[[0, -1]], [0.1, 30.0])
    np.testing.assert_allclose(relative[1:301], amplitudes, atol=1e-9)
    np.testing.assert_allclose(np.delete(relative, slice(1, 301)), 0.0, atol=1e-9)


def test_the_multisine_has_a_period_of_10_s_and_the_requested_duration_and_peak():
    series = random_multisine(4).series
    values = series["displacement"]
    assert (series.duration, series.sample_rate) == (pytest.approx(30.0), pytest.approx(2000.0))
    np.testing.assert_array_equal(values[:20_000], values[20_000:40_000])
    assert np.abs(values).max() == pytest.approx(0.0254)


def test_the_multisine_is_the_sum_of_sines_of_equation_3_26():
    # Any real signal with these lines is such a sum; this checks that the lines are multiples of 0.1 Hz.
    values = random_multisine(5, duration=10.0, rate=200.0).series["displacement"][:2000]
    lines = np.fft.rfft(values) / 1000.0
    time = np.arange(2000) / 200.0
    rebuilt = sum(
        np.abs(line) * np.sin(2 * np.pi * 0.1 * i * time + np.angle(line) + np.pi / 2)
        for i, line in enumerate(lines[:301])
    )
    np.testing.assert_allclose(values, rebuilt, atol=1e-12)


def test_more_draws_never_raise_the_crest_factor_and_seeds_differ():
    one, many = (random_multisine(6, rate=200.0, draws=draws).series["displacement"] for draws in (1, 50))
    assert crest_factor(many) < crest_factor(one)
    assert not np.allclose(many, random_multisine(7, rate=200.0).series["displacement"])
    np.testing.assert_array_equal(many, random_multisine(6, rate=200.0).series["displacement"])


@pytest.mark.parametrize("rate", [60.0, 333.33])
def test_a_sample_rate_that_cannot_represent_the_multisine_is_refused(rate):
    with pytest.raises(ValueError, match=r"multiple of 0\.1 Hz"):
        random_multisine(1, rate=rate)
