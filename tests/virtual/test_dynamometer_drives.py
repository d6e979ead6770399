"""The dynamometer's drive files: the multisine of Table 3.2, the sines of Table 3.3, static profile and bump."""

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.signals import TimeSeries
from eightpost.virtual import Actuator, bump, sine_test, sine_tests, static_steps
from eightpost.virtual.dynamometer import TABLE_3_2, crest_factor, multisine_spectrum, random_multisine

INCH = 0.0254

#: Table 3.3 as printed: amplitude [in], velocity [in/s], frequency [Hz].
PRINTED = (
    (1, 1, 0.16), (1, 3, 0.48), (1, 6, 0.95), (1, 10, 1.59), (1, 20, 3.18), (1, 30, 4.77), (0.5, 5, 1.59),
    (0.5, 10, 3.18), (0.5, 20, 6.37), (0.25, 10, 6.37), (0.25, 20, 12.73), (0.1, 2.5, 3.98), (0.1, 5, 7.96),
    (0.1, 10, 15.92),
)  # fmt: skip


def test_the_sines_have_the_values_of_table_3_3():
    found = [(s.amplitude / INCH, s.speed / INCH, s.frequency) for s in sine_tests()]
    np.testing.assert_allclose(found, PRINTED, atol=0.005)


def test_a_sine_starts_from_rest_never_exceeds_its_peak_velocity_and_becomes_steady():
    for test in sine_tests():
        x, time = test.drivefile.series["displacement"], test.drivefile.series.time
        velocity, steady = np.gradient(x, time), time >= test.start
        assert abs(velocity[1]) < 1e-3 * test.speed, test.name
        assert np.abs(velocity).max() <= 1.001 * test.speed, test.name
        expected = test.amplitude * np.sin(2 * np.pi * test.frequency * time[steady])
        np.testing.assert_allclose(x[steady], expected, atol=1e-12, err_msg=test.name)
        assert (time[-1] - test.start) * test.frequency >= 3.0 - 1e-6, test.name


@pytest.mark.parametrize(
    ("amplitude", "speed", "what"), [(0.0, 0.1, "amplitude"), (0.01, -1.0, "speed"), (0.001, 1.0, "sample rate")]
)
def test_a_sine_with_invalid_amplitude_or_speed_or_few_samples_per_cycle_is_refused(amplitude, speed, what):
    with pytest.raises(ParameterError, match=what):
        sine_test(amplitude, speed)


def test_the_static_profile_rises_and_falls_by_three_inches_with_20_s_holds():
    series = static_steps().series
    x = series["displacement"] / INCH + 3.0
    assert series.duration == pytest.approx(7 * 20.0 + 6 * 5.0)
    middles = [x[round((i * 25.0 + 10.0) * 2000)] for i in range(7)]
    assert middles == pytest.approx([2, 3, 4, 5, 4, 3, 2])
    assert np.abs(np.diff(x) * 2000).max() == pytest.approx(0.2, rel=1e-3)


def test_the_bump_has_a_height_of_half_an_inch_and_a_speed_of_30_inches_per_second():
    series = bump().series
    x = series["displacement"] / INCH
    velocity = np.gradient(x, series.time)
    assert (x.max(), x[0], x[-1]) == (pytest.approx(0.5), pytest.approx(0.0), pytest.approx(0.0))
    assert (velocity.max(), velocity.min()) == (pytest.approx(30.0, rel=1e-3), pytest.approx(-30.0, rel=1e-3))


def test_the_actuators_ripple_has_the_pitch_of_its_magnets():
    actuator = Actuator(ripple=1e-4, pitch=0.03)
    ramp = TimeSeries.from_channels([0.0, 1.0, 2.0, 3.0], {"displacement": ("m", [0.0, 0.0075, 0.015, 0.03])})
    made = actuator.follow(ramp)["displacement"] - ramp["displacement"]
    np.testing.assert_allclose(made, [0.0, 1e-4, 0.0, 0.0], atol=1e-12)


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
