"""Band-pass of measures: gain at every frequency, no phase, behaviour at the ends of a record."""

import numpy as np
import pytest
import scipy

from cosim.study.measures import Filtered, band_pass
from eightpost.errors import InputError
from eightpost.signals import TimeSeries

RATE = 200.0
TIME = np.arange(6000) / RATE
MIDDLE = slice(2000, 4000)
FREQUENCIES = (0.5, 1.0, 2.0, 5.0, 8.0, 10.0, 12.0, 20.0, 40.0)


def gain(band, frequency):
    """Return the complex gain in the middle of a record; band_pass is linear, so both parts are filtered separately."""
    wave = np.exp(2j * np.pi * frequency * TIME)
    found = band_pass(wave.real, RATE, band, "m") + 1j * band_pass(wave.imag, RATE, band, "m")
    return (found / wave)[MIDDLE]


def warped(frequency):
    """Return the frequency warped by the bilinear transform."""
    return np.tan(np.pi * frequency / RATE)


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_a_low_pass_has_the_gain_of_butterworths_fourth_order_squared(frequency):
    expected = 1.0 / (1.0 + (warped(frequency) / warped(10.0)) ** 8)
    np.testing.assert_allclose(gain((0.0, 10.0), frequency), expected, atol=1e-6)


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_a_high_pass_has_the_gain_of_butterworths_fourth_order_squared(frequency):
    expected = 1.0 / (1.0 + (warped(2.0) / warped(frequency)) ** 8)
    np.testing.assert_allclose(gain((2.0, np.inf), frequency), expected, atol=1e-6)


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_a_band_has_the_gain_of_butterworths_fourth_order_squared_on_both_sides(frequency):
    low, high, here = warped(2.0), warped(10.0), warped(frequency)
    expected = 1.0 / (1.0 + ((here**2 - low * high) / (here * (high - low))) ** 8)
    np.testing.assert_allclose(gain((2.0, 10.0), frequency), expected, atol=1e-6)


@pytest.mark.parametrize("band", [(0.0, 10.0), (2.0, np.inf), (2.0, 10.0), (0.5, 60.0)])
def test_a_record_is_extended_at_its_ends_as_by_scipys_sosfiltfilt(band):
    """The extension is an odd reflection; a record with arbitrary ends shows its length."""
    values = 3.0 + np.cumsum(np.random.default_rng(2).standard_normal(400))
    low, high = band
    kind, edges = (
        ("bandpass", band) if low and np.isfinite(high) else ("lowpass", high) if not low else ("highpass", low)
    )
    sections = scipy.signal.butter(4, edges, kind, fs=RATE, output="sos")
    expected = scipy.signal.sosfiltfilt(sections, values, padtype="odd", padlen=3 * (2 * len(sections) + 1))
    np.testing.assert_allclose(band_pass(values, RATE, band, "m"), expected, rtol=0.0, atol=1e-9)


def test_a_low_pass_does_not_change_a_straight_line_even_at_its_ends():
    line = 5.0 - 2.0 * TIME[:300]
    np.testing.assert_allclose(band_pass(line, RATE, (0.0, 60.0), "m"), line, atol=1e-4)


def test_a_band_open_on_both_sides_is_the_record_itself():
    assert band_pass(TIME, RATE, (0.0, np.inf), "m") is TIME


@pytest.mark.parametrize(("band", "fewest"), [((0.0, 10.0), 16), ((2.0, np.inf), 16), ((2.0, 10.0), 28)])
def test_a_record_must_be_longer_than_its_padding(band, fewest):
    assert band_pass(np.ones(fewest), RATE, band, "m").shape == (fewest,)
    with pytest.raises(InputError, match=f"measure 'm': {fewest - 1} samples are too few .* needs {fewest}$"):
        band_pass(np.ones(fewest - 1), RATE, band, "m")


@pytest.mark.parametrize("band", [(0.0, 100.0), (2.0, 100.0), (100.0, np.inf), (150.0, np.inf)])
def test_a_band_that_reaches_half_the_rate_is_refused(band):
    with pytest.raises(InputError, match="exceeds half the sample rate of 200 Hz"):
        band_pass(TIME, RATE, band, "m")
    if band[0] < 101.0:
        band_pass(TIME, RATE, tuple(0.99 * edge for edge in band), "m")


def test_a_window_includes_the_samples_at_both_ends():
    run = Filtered(TimeSeries.from_channels(TIME[:11], {"x": ("N", TIME[:11])}))
    assert run.samples(0.01, 0.03) == slice(2, 7)
    assert run.samples(0.01 + 1e-4, 0.03 - 1e-4) == slice(3, 6)
    assert run.samples(-np.inf, np.inf) == slice(0, 11)


def test_a_filtered_channel_is_computed_once_for_each_band():
    run = Filtered(TimeSeries.from_channels(TIME, {"x": ("N", np.sin(TIME))}))
    assert np.array_equal(run.channel("x", None, "m"), np.sin(TIME))
    first, second = (run.channel("x", (0.0, high), "m") for high in (10.0, 20.0))
    assert run.channel("x", (0.0, 10.0), "m") is first
    assert not np.array_equal(first, second)
