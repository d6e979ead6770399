"""The sines have the values of Table 3.3 and start smoothly; the static profile and bump follow Fig 3.12 and 3.13."""

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.signals import TimeSeries
from eightpost.virtual import Actuator, bump, sine_test, sine_tests, static_steps

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


@pytest.mark.parametrize("test", sine_tests(), ids=lambda test: test.name)
def test_a_sine_starts_from_rest_never_exceeds_its_peak_velocity_and_becomes_steady(test):
    series = test.drivefile.series
    x, time = series["displacement"], series.time
    velocity = np.gradient(x, time)
    assert abs(velocity[1]) < 1e-3 * test.speed
    assert np.abs(velocity).max() <= 1.001 * test.speed
    steady = time >= test.start
    expected = test.amplitude * np.sin(2 * np.pi * test.frequency * time[steady])
    np.testing.assert_allclose(x[steady], expected, atol=1e-12)
    assert (time[-1] - test.start) * test.frequency >= 3.0 - 1e-6


@pytest.mark.parametrize(
    ("amplitude", "speed", "rate"), [(0.0, 0.1, 2000.0), (0.01, -1.0, 2000.0), (0.001, 1.0, 500.0)]
)
def test_a_sine_with_invalid_amplitude_speed_or_rate_is_refused(amplitude, speed, rate):
    with pytest.raises(ParameterError):
        sine_test(amplitude, speed, rate=rate)


def test_the_static_profile_rises_and_falls_by_three_inches_with_20_s_holds():
    series = static_steps(rate=200.0).series
    x = series["displacement"] / INCH + 3.0
    assert series.duration == pytest.approx(7 * 20.0 + 6 * 5.0)
    middles = [x[round((i * 25.0 + 10.0) * 200)] for i in range(7)]
    assert middles == pytest.approx([2, 3, 4, 5, 4, 3, 2])
    assert np.abs(np.diff(x) * 200).max() == pytest.approx(0.2, rel=1e-3)


def test_the_bump_has_a_height_of_half_an_inch_and_a_speed_of_30_inches_per_second():
    series = bump().series
    x = series["displacement"] / INCH
    velocity = np.gradient(x, series.time)
    assert (x.max(), x[0], x[-1]) == (pytest.approx(0.5), pytest.approx(0.0), pytest.approx(0.0))
    assert (velocity.max(), velocity.min()) == (pytest.approx(30.0, rel=1e-3), pytest.approx(-30.0, rel=1e-3))
    with pytest.raises(ParameterError, match="rounded"):
        bump(speed=5.0)


def test_the_actuators_ripple_has_the_pitch_of_its_magnets():
    actuator = Actuator(ripple=1e-4, pitch=0.03)
    ramp = TimeSeries.from_channels([0.0, 1.0, 2.0, 3.0], {"displacement": ("m", [0.0, 0.0075, 0.015, 0.03])})
    made = actuator.follow(ramp)["displacement"] - ramp["displacement"]
    np.testing.assert_allclose(made, [0.0, 1e-4, 0.0, 0.0], atol=1e-12)
